"""Error against time of dense flow methods, on simulated robots with exact flow.

    python profiling/flow_methods.py [--scan] [--robots arm,planar] [--seeds 0,1,2] [--speeds 1,2,3,4] [--json FILE]

End-point error |u - u*| over the robot's pixels: its median and mean, and the mean over those within 4 px of the
robot's outline, where two motions meet. ``--scan`` adds settings of DIS and Farneback around ours. A method is
marked where no other is both faster and better in median and near the outline.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from flow_candidates import Flow, candidates
from flow_pairs import FlowPair, flow_pairs
from interleaved import interleaved
from metrics import Metric, add_report_arguments, report
from recorded_frames import image_size

from dense_vs.flow.estimator import METHODS
from dense_vs.view.tables import table


@dataclass(frozen=True)
class FlowScore:
    """How a method did: errors [px], time [ms]."""

    name: str
    ms: float
    median: float
    mean: float
    outline: float
    by_speed: tuple[float, ...]

    def dominates(self, other: "FlowScore") -> bool:
        """No worse in all three, better in one."""
        mine, theirs = ((s.ms, s.median, s.outline) for s in (self, other))
        return all(a <= b for a, b in zip(mine, theirs, strict=True)) and mine != theirs


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scan", action="store_true")
    parser.add_argument("--robots", default="arm,planar", help="by comma")
    parser.add_argument("--seeds", default="0,1,2", help="by comma")
    parser.add_argument("--speeds", default="1,2,3,4", help="px per frame, by comma")
    parser.add_argument("--size", default="320x240", metavar="WxH")
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    width, height = image_size(options.size)
    asked = [float(speed) for speed in options.speeds.split(",")]
    pairs = [
        pair
        for robot in options.robots.split(",")
        for seed in map(int, options.seeds.split(","))
        for pair in flow_pairs(robot, seed, asked, height, width)
    ]
    speeds = [float(np.median(np.linalg.norm(pair.flow, axis=2)[pair.robot])) for pair in pairs]
    print(f"{len(pairs)} pairs of {options.size}, median speed from {min(speeds):.1f} to {max(speeds):.1f} px a frame")
    scores = compare(candidates(options.scan), pairs, asked)
    print_scores(scores, asked)
    return report([metric for score in scores if score.name in METHODS for metric in _metrics(score)], options)
    return 0


def compare(methods: dict[str, Flow], pairs: Sequence[FlowPair], speeds: Sequence[float]) -> list[FlowScore]:
    """Errors over all pairs and interleaved times of every method, the fastest first."""
    errors = {name: [end_point_errors(flow, pair) for pair in pairs] for name, flow in methods.items()}
    calls = {
        name: lambda k, flow=flow: flow(pairs[k % len(pairs)].present, pairs[k % len(pairs)].previous)
        for name, flow in methods.items()
    }
    seconds = interleaved(calls, min(len(pairs), 40))
    scores = []
    for name, of_pairs in errors.items():
        robot = np.concatenate([on_robot for on_robot, _ in of_pairs])
        outline = np.concatenate([near for _, near in of_pairs])
        by_speed = tuple(
            float(np.median(np.concatenate([e for (e, _), p in zip(of_pairs, pairs, strict=True) if p.speed == speed])))
            for speed in speeds
        )
        ms = 1e3 * float(np.median(seconds[name]))
        scores.append(
            FlowScore(name, ms, float(np.median(robot)), float(robot.mean()), float(outline.mean()), by_speed)
        )
    return sorted(scores, key=lambda score: score.ms)


def end_point_errors(flow: Flow, pair: FlowPair) -> tuple[np.ndarray, np.ndarray]:
    """|u - u*| [px] at the robot's pixels, and at those near its outline."""
    error = np.linalg.norm(-flow(pair.present, pair.previous) - pair.flow, axis=2)
    return error[pair.robot], error[pair.outline]


def print_scores(scores: Sequence[FlowScore], speeds: Sequence[float]) -> None:
    """The table; a star marks the methods of the library."""
    header = ["method", "ms", "median px", "mean px", "outline px", *(f"median at {s:g}" for s in speeds), ""]
    rows = []
    for score in scores:
        best = not any(other.dominates(score) for other in scores)
        figures = [score.median, score.mean, score.outline, *score.by_speed]
        name = f"{score.name} *" if score.name in METHODS else score.name
        rows.append([name, f"{score.ms:.1f}", *(f"{figure:.3f}" for figure in figures), "undominated" if best else ""])
    print("\n" + table(header, rows))
    print("* a method of dense_vs.flow.estimator")


def _metrics(score: FlowScore) -> list[Metric]:
    name = f"flow_{score.name.replace('-', '_')}"
    return [
        Metric(f"{name}_ms", score.ms, "ms", "lower", 0.2),
        Metric(f"{name}_median_error", score.median, "px", "lower", 0.05),
        Metric(f"{name}_outline_error", score.outline, "px", "lower", 0.05),
    ]


if __name__ == "__main__":
    raise SystemExit(main())
