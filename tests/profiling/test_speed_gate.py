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
