"""The gate: ratios that got worse by more than their tolerance, and nothing else."""

import importlib.util
from pathlib import Path

import pytest

SPEC = importlib.util.spec_from_file_location("metrics", Path(__file__).parents[2] / "profiling" / "metrics.py")
metrics = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(metrics)


def metric(value, unit="x", better="higher", tolerance=0.1, name="speed"):
    return metrics.Metric(name, value, unit, better, tolerance)


def baseline(*of):
    return {one.name: {"value": one.value} for one in of}


@pytest.mark.parametrize(
    ("before", "now", "better", "passes"),
    [
        (10.0, 9.1, "higher", True),
        (10.0, 8.9, "higher", False),
        (10.0, 20.0, "higher", True),
        (1.0, 1.05, "lower", True),
        (1.0, 1.2, "lower", False),
        (10.0, float("nan"), "higher", False),
    ],
)
def test_a_ratio_beyond_its_tolerance_fails(before, now, better, passes):
    lines = metrics.regressions([metric(now, better=better)], baseline(metric(before)))
    assert (lines == []) == passes
    if not passes:
        assert "speed" in lines[0]


def test_times_are_never_compared():
    ratio = metric(1.0, name="ratio")
    slow = metric(99.0, unit="ms", better="lower")
    assert metrics.regressions([slow, ratio], baseline(metric(1.0, unit="ms"), ratio)) == []


def test_a_baseline_of_something_else_fails():
    assert "no ratio" in metrics.regressions([metric(1.0)], baseline(metric(1.0, name="other")))[0]
