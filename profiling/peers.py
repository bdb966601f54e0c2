"""Predict and update, and a whole frame, against other implementations of the same arithmetic, in one run.

    python profiling/peers.py [--size 320x240] [--joints 4] [--rounds 20] [--runs 3] [--json FILE]

Predict and update is (14) once and (9) to (11) with a variance per pixel and joint, as published. Every peer has the
same float32 input and, but for PyTorch, arrays allocated beforehand, in the layout that suits it best, and is checked
against the others before anything is timed. Ours is the whole of ``DenseJacobian.update``, with its checks of the input
and the copy of the flow; Taichi is timed from data in its own arrays, kernel and synchronization alone.

The whole frame is compared twice: without labels on either side, and with a label for every pixel on both, ours those
of ``SelfBody()``, the paper's those of its Algorithm 2 (the k-means of Algorithm 1, which runs beside, is left out).
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
import warp as wp
from filter_case import FilterCase, make_case
from interleaved import interleaved, median_ratio
from machine_facts import machine_facts, spread
from metrics import Metric, add_report_arguments, report
from peer_numpy import NumpyPlanesFilter
from peer_opencv import OpencvFilter
from peer_paper_pipeline import PaperPipeline
from peer_plain import NumpyFilter, ScipyFilter
from peer_scipy import ScipyPlanesFilter
from recorded_frames import Recording, Replay, image_size, record
from results_file import in_words
from taichi_jacobian import TaichiFilter

from dense_vs import DenseJacobian, SelfBody, ServoLoop
from dense_vs.view.tables import table

WARMUP = 5
AGREEMENT = 1e-4  # of the largest |J| or variance
PEERS = {
    "scipy": ScipyFilter,
    "numpy": NumpyFilter,
    "opencv": OpencvFilter,
    "taichi": TaichiFilter,
    "scipy_planes": ScipyPlanesFilter,
    "numpy_planes": NumpyPlanesFilter,
}
if find_spec("torch"):
    from peer_torch import TorchFilter

    PEERS["torch"] = TorchFilter


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 1 where the implementations disagree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="320x240", metavar="WxH")
    parser.add_argument("--joints", type=int, default=4, help="of predict and update; the whole frame is the arm's")
    parser.add_argument("--rounds", type=int, default=20, help="of each run")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument(
        "--calls", type=int, default=5, help="calls of each in a row; 1 times every call on emptied caches (default: 5)"
    )
    parser.add_argument("--seed", type=int, default=0)
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    width, height = image_size(options.size)
    case = make_case(height, width, options.joints, seed=options.seed)
    print(f"predict and update, {width}x{height}, {options.joints} joints")
    worst = disagreement(case)
    if worst > AGREEMENT:
        print(f"the implementations disagree by {worst:.1e}; expected at most {AGREEMENT:.0e}", file=sys.stderr)
        return 1
    frames = options.rounds + WARMUP + 1
    recording = record("arm", height, width, frames=frames, seed=options.seed)
    runs: dict[str, list[Metric]] = {}
    for _ in range(options.runs):
        for metric in predict_update(case, options.rounds, options.calls) + whole_frame(recording, options.rounds):
            runs.setdefault(metric.name, []).append(metric)
    ranges = {name: spread([metric.value for metric in found]) for name, found in runs.items()}
    metrics = [replace(found[0], value=ranges[name][1]) for name, found in runs.items()]
    facts = machine_facts()
    print(f"\n{in_words(facts)}\n\n" + table(("metric", "from", "to"), _rows(ranges)))
    return report(metrics, options, machine_facts=facts, ranges=ranges)


def _rows(ranges: dict[str, list[float]]) -> list[list[str]]:
    return [[name, f"{least:.3g}", f"{most:.3g}"] for name, (least, _, most) in ranges.items()]


def our_filter(case: FilterCase) -> DenseJacobian:
    """Ours with the peers' arithmetic."""
    height, width, joints = case.size
    noises = case.noises
    return DenseJacobian(
        height=height,
        width=width,
        joints=joints,
        device="cpu",
        covariance="diagonal",
        prediction_iterations=1,
        initial_variance=noises.initial_variance,
        max_variance=noises.max_variance,
        process_noise=noises.process_noise,
        measurement_noise=noises.measurement_noise,
    )


def disagreement(case: FilterCase) -> float:
    """Largest relative difference of J or variance between any peer and ours after the case's frames; printed."""
    ours = our_filter(case)
    for flow, dq in zip(case.flow, case.dq, strict=True):
        ours.update(flow, dq)
    rows, worst = [], 0.0
    for name, peer_class in PEERS.items():
        peer = peer_class(*case.size, case.noises)
        for flow, dq in zip(case.flow, case.dq, strict=True):
            peer.update(peer.load(flow) if isinstance(peer, TaichiFilter) else flow, dq)
        differences = [
            float(np.abs(getattr(peer, field) - getattr(ours, field)).max() / np.abs(getattr(ours, field)).max())
            for field in ("jacobian", "variance")
        ]
        worst = max(worst, *differences)
        rows.append([name, *(f"{difference:.1e}" for difference in differences)])
    print(table(("peer", "J differs by", "variance differs by"), rows))
    return worst


def predict_update(case: FilterCase, rounds: int, calls: int) -> list[Metric]:
    """Ratios theirs / ours of one update."""
    height, width, joints = case.size
    default = DenseJacobian(height=height, width=width, joints=joints, device="cpu")
    filters = {"ours": our_filter(case), "ours, default mode": default}
    filters |= {name: peer_class(*case.size, case.noises) for name, peer_class in PEERS.items()}
    updates = {name: _cycled(filter_, case) for name, filter_ in filters.items()}
    seconds = interleaved(updates, rounds, calls=calls)
    ours = seconds["ours"]
    rows = [
        [name, f"{1e3 * np.median(spent):.2f}", f"{median_ratio(spent, ours):.2f}"] for name, spent in seconds.items()
    ]
    print("\n" + table(("implementation", "ms", "times ours"), rows))
    ratios = [
        Metric(f"predict_update_vs_{name}", median_ratio(seconds[name], ours), "x", "higher", 0.15) for name in PEERS
    ]
    times = {"predict_update_diagonal": ours, "predict_update_default": seconds["ours, default mode"]}
    return ratios + [Metric(f"{name}_ms", 1e3 * float(np.median(t)), "ms", "lower", 0.2) for name, t in times.items()]


def _cycled(filter_: Any, case: FilterCase) -> Callable[[int], None]:
    """Update by the case's frames in turn."""
    flows = [filter_.load(flow) for flow in case.flow] if isinstance(filter_, TaichiFilter) else list(case.flow)

    def update(round_number: int) -> None:
        k = round_number % len(flows)
        filter_.update(flows[k], case.dq[k])

    return update


def whole_frame(recording: Recording, rounds: int) -> list[Metric]:
    """Ratios of the paper's frame to ours, from image and joints to the next command, with labels and without."""
    frames = {}
    for labels in (False, True):
        frames[_frame_name("paper", labels)] = _paper_frame(recording, labels)
        frames[_frame_name("ours", labels)] = _our_frame(recording, labels)
    seconds = interleaved(frames, rounds, WARMUP)
    print(
        "\n"
        + table(("whole frame", "ms"), [[name, f"{1e3 * np.median(spent):.1f}"] for name, spent in seconds.items()])
    )
    metrics = []
    for labels in (False, True):
        theirs, ours = (seconds[_frame_name(side, labels)] for side in ("paper", "ours"))
        name = f"frame_vs_paper_{'with' if labels else 'without'}_labels"
        metrics.append(Metric(name, median_ratio(theirs, ours), "x", "higher", 0.15))
    return metrics


def _frame_name(side: str, labels: bool) -> str:
    return f"{side}, {'with' if labels else 'without'} labels"


def _paper_frame(recording: Recording, labels: bool) -> Callable[[int], object]:
    target = recording.tip[0] + 20.0
    paper = PaperPipeline(recording.rgb[0], recording.positions.shape[1], recording.tip[0], target, labels=labels)
    steps = np.diff(recording.positions, axis=0).astype(np.float32)
    return lambda k: paper.frame(recording.rgb[k + 1], steps[k])


def _our_frame(recording: Recording, labels: bool) -> Callable[[int], object]:
    target = recording.tip[0] + 20.0
    loop = ServoLoop(replay := Replay(recording), replay, body=SelfBody() if labels else None)
    loop.define_point(recording.tip[0])

    def frame(_: int) -> None:
        loop.reach(target, max_frames=1)
        if labels:
            loop.pipeline.labels()

    return frame


if __name__ == "__main__":
    raise SystemExit(main())
