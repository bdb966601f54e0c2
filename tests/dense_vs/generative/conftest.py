"""A recording of a simulated arm, and a model of it, that the tests share."""

import pytest
from arm_recordings import record

from dense_vs.generative import GenerativeModel


@pytest.fixture(scope="session")
def ur5():
    return record("ur5", 0)


@pytest.fixture(scope="session")
def model(ur5):
    return GenerativeModel.fit(ur5.observations())


@pytest.fixture
def copied(model, tmp_path):
    """A model of its own, for tests that change it."""
    model.save(tmp_path / "model.npz")
    return GenerativeModel.load(tmp_path / "model.npz")
