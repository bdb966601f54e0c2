"""What counts as growth, with runs made by hand."""

import sys
from pathlib import Path

import numpy as np
import pytest

PROFILING = str(Path(__file__).parents[2] / "profiling")
MINUTES = np.arange(31.0)
NOISE = np.random.default_rng(4).normal(0.0, 3.0, 31)  # MB


@pytest.fixture
def growth(monkeypatch):
    monkeypatch.syspath_prepend(PROFILING)
    import growth

    yield growth.growth
    sys.modules.pop("growth", None)


@pytest.mark.parametrize(
    "values",
    [
        np.full(31, 700.0),
        700.0 + NOISE,
        700.0 + 20.0 * (MINUTES % 3),  # filled and freed again
        700.0 + 150.0 * np.minimum(MINUTES / 6, 1.0) + NOISE,  # buffers fill in the beginning
        700.0 + 400.0 * (MINUTES == 27),  # one peak, near the end
        700.0 - 2.0 * MINUTES,
    ],
    ids=["flat", "noise", "saw", "warm", "peak", "falls"],
)
def test_no_growth(growth, values):
    assert not growth(MINUTES, values, 10.0).grows


@pytest.mark.parametrize(
    ("values", "allowed", "rise"),
    [
        (700.0 + 1.0 * MINUTES + NOISE, 10.0, 20.0),  # a megabyte a minute
        (700.0 + 150.0 * np.minimum(MINUTES / 6, 1.0) + 2.0 * MINUTES, 10.0, 40.0),  # a leak behind a warm start
        (40.0 + np.floor(MINUTES / 4), 2.0, 5.0),  # a file every four minutes stays open
        (700.0 + 20.0 * (MINUTES % 3) + 3.0 * MINUTES, 10.0, 60.0),
    ],
    ids=["slow", "warm", "files", "saw"],
)
def test_growth(growth, values, allowed, rise):
    found = growth(MINUTES, values, allowed)
    assert found.grows
    assert found.rise == pytest.approx(rise, rel=0.25)


def test_level_and_scatter_are_those_of_the_settled_part(growth):
    found = growth(MINUTES, np.where(MINUTES < 8, 5.0, 9.0), 1.0)
    assert (found.level, found.rise, found.scatter) == (9.0, 0.0, 0.0)


@pytest.mark.parametrize("values", [np.arange(5.0), np.full(31, np.nan)], ids=["few", "not finite"])
def test_what_cannot_be_judged_is_an_error(growth, values):
    with pytest.raises(ValueError, match="samples"):
        growth(MINUTES[: len(values)], values, 1.0)
