"""The gate of the closed loop, with results made by hand."""

import sys
from pathlib import Path

import pytest

PROFILING = str(Path(__file__).parents[2] / "profiling")
H200 = {"cpu": "some processor", "cores": 16, "gpus": ["NVIDIA H200"]}
FRAMES = "closed loop, 1024 worlds, cuda:0"
FLOW = "flow, 1024 worlds, cuda:0"
SHARE = "share reached, 1024 worlds, cuda:0"


@pytest.fixture
def gate(monkeypatch):
    monkeypatch.syspath_prepend(PROFILING)
    import metrics
    import speed_gate

    def held(frames=34000.0, flow=13.0, share=1.0, machine=H200, order=1, names=(FRAMES, FLOW, SHARE)):
        ours = [
            metrics.Metric(names[0], frames, "frames/s", "higher", 0.05),
            metrics.Metric(names[1], flow, "ms", "lower", 0.1),
            metrics.Metric(names[2], share, "1", "higher", 0.01),
        ]
        here = {"machine": machine, "arguments": {"worlds": 1024, "order": order, "device": "auto", "gpus": None}}
        before = {
            "machine": H200,
            "arguments": {"worlds": 1024, "order": 1, "device": "cuda:0"},
            "metrics": [
                {"name": FRAMES, "value": 34000.0},
                {"name": FLOW, "value": 13.0},
                {"name": SHARE, "value": 1.0},
                {"name": "of another part", "value": 3.0},
            ],
        }
        return speed_gate.hold_to(ours, here, before, "closed_loop_h200.json")

    yield held
    for name in ("metrics", "speed_gate"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("change", [{}, {"frames": 30700.0}, {"flow": 14.2}, {"frames": 90000.0, "flow": 4.0}])
def test_a_loss_of_up_to_a_tenth_passes(gate, change):
    good, lines = gate(**change)
    assert good
    assert lines == ["gate passed: 3 figures against closed_loop_h200.json, measured on NVIDIA H200"]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"frames": 30500.0}, f"gate failed: {FRAMES}: 3.05e+04 frames/s, was 3.4e+04, may lose 10%"),
        ({"flow": 14.4}, f"gate failed: {FLOW}: 14.4 ms, was 13, may lose 10%"),
        ({"share": 0.98}, f"gate failed: {SHARE}: 0.98 1, was 1, may lose 1%"),
        ({"frames": float("nan")}, f"gate failed: {FRAMES}: nan frames/s, was 3.4e+04, may lose 10%"),
    ],
)
def test_a_larger_loss_fails(gate, change, line):
    assert gate(**change) == (False, [line])


def test_another_kind_of_machine_is_said_and_passes(gate):
    for machine, kind in (
        (H200 | {"gpus": ["NVIDIA L4"]}, "NVIDIA L4"),
        (H200 | {"gpus": ["NVIDIA H200"] * 2}, "NVIDIA H200, NVIDIA H200"),
        ({"cpu": "some processor", "cores": 2, "gpus": []}, "2 cores of some processor"),
    ):
        good, (line,) = gate(frames=1.0, machine=machine)
        assert good
        assert line == (
            "gate passed without a comparison: closed_loop_h200.json was measured on NVIDIA H200, this run on " + kind
        )


def test_other_arguments_fail(gate):
    good, (line,) = gate(order=2)
    assert not good
    assert "was measured with order 1 in place of 2; expected the same arguments" in line


def test_nothing_to_compare_fails(gate):
    good, (line,) = gate(names=("a", "b", "c"))
    assert not good
    assert "has no figure of this run" in line


def test_both_results_stand_side_by_side(gate):
    import metrics
    import speed_gate

    ours = [metrics.Metric(FLOW, 4.0, "ms", "lower"), metrics.Metric("new", 1.0, "ms", "lower")]
    assert speed_gate.beside(ours, {"metrics": [{"name": FLOW, "value": 16.0}, {"name": "old", "value": 1.0}]}) == [
        [FLOW, "16", "4", "ms", "0.25"]
    ]


def held(metric, was, **told):
    import speed_gate

    here = {"machine": H200, "arguments": {"order": 1, **told}}
    before = {"machine": H200, "arguments": {"order": 1, "flow": "farneback"}}
    return speed_gate.hold_to([metric], here, {**before, "metrics": [{"name": metric.name, "value": was}]}, "old.json")


@pytest.mark.parametrize(
    ("unit", "better", "was", "now", "good"),
    [
        ("ms", "lower", -20.0, -18.0, True),  # a tenth of what it was, whatever its sign
        ("ms", "lower", -20.0, -17.9, False),
        ("fps", "higher", -20.0, -22.0, True),
        ("fps", "higher", -20.0, -22.1, False),
        ("ms", "lower", 20.0, 22.0, True),
        ("fps", "higher", 20.0, 18.0, True),
        ("px", "lower", 20.0, 25.0, True),  # by its own tolerance
        ("px", "lower", 20.0, 25.1, False),
        ("x", "higher", 20.0, 15.0, True),
        ("1", "higher", 20.0, 14.9, False),
        ("MB", "lower", 20.0, 23.0, False),
        ("ms", "lower", 0.0, 0.0, True),
    ],
)
@pytest.mark.usefixtures("gate")
def test_the_border_of_what_may_be_lost(unit, better, was, now, good):
    import metrics

    assert held(metrics.Metric("figure", now, unit, better, 0.25), was)[0] == good


@pytest.mark.usefixtures("gate")
def test_another_flow_is_another_way_to_the_same_figures():
    import metrics

    metric = metrics.Metric("figure", 1.0, "ms", "lower")
    assert held(metric, 1.0, flow="other", more="unknown before") == (
        True,
        ["gate passed: 1 figures against old.json, measured on NVIDIA H200"],
    )
    good, (line,) = held(metric, None)  # it was no number then
    assert not good
    assert "has no figure of this run" in line


@pytest.mark.usefixtures("gate")
def test_kinds_of_machines():
    import speed_gate

    assert speed_gate.machine_kind({"cores": 4, "cpu": "fast", "gpus": None}) == "4 cores of fast"
    assert speed_gate.machine_kind({}) == "? cores of unknown"


@pytest.mark.usefixtures("gate")
def test_what_was_nothing_has_no_ratio():
    import metrics
    import speed_gate

    figure = metrics.Metric("figure", 3.0, "ms", "lower")
    for was, expected in ((0.0, [["figure", "0", "3", "ms", ""]]), (-6.0, [["figure", "-6", "3", "ms", "-0.50"]])):
        assert speed_gate.beside([figure], {"metrics": [{"name": "figure", "value": was}]}) == expected
    assert speed_gate.beside([figure], {"metrics": [{"name": "figure", "value": None}]}) == []
