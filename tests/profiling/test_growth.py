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


@pytest.mark.parametrize(
    "values",
    [np.arange(5.0), np.full(31, np.nan), np.where(MINUTES == 29, np.nan, 7.0)],
    ids=["few", "not finite", "one not finite"],
)
def test_what_cannot_be_judged_is_an_error(growth, values):
    with pytest.raises(ValueError, match="samples"):
        growth(MINUTES[: len(values)], values, 1.0)


# Even about the middle, so that the line has the slope of what it is added to; off by 1 in the median.
RIPPLE = np.array([5.0, -1.0, 1.0, -1.0, 0.0, -1.0, 1.0, -1.0, 5.0])
LATE = np.arange(13.0)  # minutes, of which the last nine are judged


@pytest.mark.parametrize(
    ("slope", "allowed", "grows"),
    [
        (0.125, 0.0, False),  # a rise of 1: just what the scatter of 1 explains, 3 times that by the root of 9
        (0.1875, 0.0, True),
        (0.1875, 1.25, True),  # a rise of 1.5
        (0.1875, 1.5, False),  # just what is allowed
        (0.1875, 2.0, False),  # both have to be exceeded
        (-0.5, 0.0, False),
    ],
)
def test_a_rise_has_to_exceed_scatter_and_allowance(growth, slope, allowed, grows):
    values = 50.0 + slope * LATE
    values[4:] += RIPPLE
    values[:4] = 900.0  # not settled
    found = growth(LATE, values, allowed)
    assert (found.rise, found.scatter) == (8 * slope, 1.0)
    assert found.grows == grows


def test_the_first_third_is_that_of_the_run_whenever_it_began(growth):
    found = growth(100.0 + np.arange(10.0), [90.0, 90.0, 90.0, *(2.0 * np.arange(3.0, 10.0))], 11.0)
    assert (found.level, found.rise, found.scatter, found.grows) == (12.0, 12.0, 0.0, True)


def test_samples_of_one_moment_have_no_slope_between_them(growth):
    minutes = [0.0, 3.0, 3.0, 5.0, 7.0, 9.0, 9.0]
    found = growth(minutes, 2.0 * np.array(minutes), 11.0)
    assert (found.rise, found.grows) == (12.0, True)


def test_six_samples_are_enough_and_five_are_not(growth):
    assert growth(np.arange(9.0), np.full(9, 1.0), 1.0).level == 1.0  # minutes 3 to 8
    with pytest.raises(ValueError, match="5 samples after the first third; expected at least 6"):
        growth(np.arange(8.0)[1:], np.full(7, 1.0), 1.0)
    with pytest.raises(ValueError, match="samples are not finite"):
        growth([*np.arange(8.0), np.inf], np.full(9, 1.0), 1.0)
