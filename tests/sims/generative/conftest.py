"""One cell, one observed arm and one learnt model for all tests of the generative model's simulated evidence."""

import pytest

from dense_vs.generative import GenerativeModel
from dense_vs.sims.experiments.generative.protocol import Trial
from dense_vs.sims.generative.workcell import Workcell


@pytest.fixture(scope="session")
def cell():
    """Tests put it where they need it."""
    return Workcell("ur5", peg=True, seed=3)


@pytest.fixture(scope="session")
def trial():
    return Trial("ur5", 5, 2, "normal")


@pytest.fixture(scope="session")
def learnt(trial):
    return GenerativeModel.fit(trial.evidence(30).observations, seed=0)
