"""A report of figures holds its ratios to an earlier one."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "profiling"))

import metrics


@pytest.mark.parametrize(
    ("now", "better", "tolerance", "code"),
    [
        (1.1, "lower", 0.1, 0),
        (1.11, "lower", 0.1, 1),
        (0.9, "higher", 0.1, 0),
        (0.89, "higher", 0.1, 1),
        (2.0, "higher", 0.1, 0),
        (0.1, "lower", 0.1, 0),
        (0.89, "higher", 0.2, 0),
    ],
)
def test_a_report_holds_its_ratios_to_the_gate(tmp_path, capsys, now, better, tolerance, code):
    gate, file = tmp_path / "gate.json", tmp_path / "now.json"
    gate.write_text('{"metrics": [{"name": "share", "value": 1.0}, {"name": "other", "value": 9.0}]}')
    found = [metrics.Metric("share", now, "1", better, tolerance), metrics.Metric("time", 99.0, "ms", "lower")]
    arguments = SimpleNamespace(json=file, gate=gate)
    assert metrics.report(found, arguments) == code
    assert ("share" in capsys.readouterr().err) == bool(code)
    assert f'"value": {now}' in file.read_text()
    assert metrics.report(found, SimpleNamespace(json=None, gate=None)) == 0


@pytest.mark.parametrize(
    ("unit", "better", "before", "now", "worse"),
    [
        ("x", "lower", -20.0, -18.0, False),  # a tenth of what it was, whatever its sign
        ("x", "lower", -20.0, -17.9, True),
        ("1", "higher", -20.0, -22.0, False),
        ("1", "higher", -20.0, -22.1, True),
        ("1", "lower", 20.0, 22.0, False),
        ("1", "higher", 20.0, 18.0, False),
    ],
)
def test_the_border_of_a_tolerance(unit, better, before, now, worse):
    found = metrics.regressions([metrics.Metric("figure", now, unit, better)], {"figure": {"value": before}})
    assert bool(found) == worse


def test_only_ratios_that_both_have_are_compared():
    figures = [metrics.Metric("time", 9.0, "ms", "lower"), metrics.Metric("new", 9.0, "1", "lower")]
    lines = metrics.regressions(figures, {"time": {"value": 1.0}})
    assert lines == ["no ratio of this run is in the baseline; expected one measured by the same script and arguments"]
    figures.append(metrics.Metric("ratio", 9.0, "x", "lower"))
    assert metrics.regressions(figures, {"ratio": {"value": 4.0}}) == ["ratio: 9, was 4, tolerance 10%"]
