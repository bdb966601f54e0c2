"""How good J and the reaches are, over robots and seeds, against the simulator's exact truth.

Each world babbles for 10 s as ``dense-vs reach`` does. The same images and joint readings then go through the
estimator in each mode, the paper's beside the default, with estimated and with exact flow; the default's loop
goes on to its targets. No seed is left out.
"""

import argparse
from typing import Any

import numpy as np
import warp as wp
from metrics import Metric, add_report_arguments, report

from dense_vs.jacobian.error import JacobianError, jacobian_error
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.sims import SimWorld
from dense_vs.sims.papers.dije.reaching import MeasuredReach, ReachingExperiment
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

PAPER: dict[str, Any] = {"covariance": "diagonal", "prediction_iterations": 1}
MODES: dict[str, dict[str, Any]] = {
    "default": {},
    "default, order 1": {"order": 1},
    "diagonal (9)-(11), model (14)": PAPER,
    "diagonal (9)-(11), flow (13)": {**PAPER, "prediction": "flow"},
    "Hosoda (12), model (14)": {"covariance": "fixed", "prediction_iterations": 1},
}
REACHED_PX = 2.0


def run_world(
    robot: str, seed: int, targets: int, distractor: str
) -> tuple[dict[str, JacobianError], list[MeasuredReach]]:
    """Errors of J by mode, and the default's reaches."""
    world = SimWorld(robot, seed=seed, distractor=distractor)
    size = {"height": world.shape[1], "width": world.shape[2], "joints": len(world.joint_names)}
    others = {f"{name}, {kind} flow": DenseJacobian(**size, on_bad_flow="skip", **options)
              for name, options in MODES.items() for kind in ("estimated", "exact")}  # fmt: skip
    del others["default, estimated flow"]

    def feed(experiment: ReachingExperiment) -> None:
        frame = experiment.loop.frame
        if experiment.surface_point is not None or frame.flow is None:
            return
        exact = world.true_flow()
        for name, estimator in others.items():
            estimator.update(exact if name.endswith("exact flow") else frame.flow, frame.dq)

    experiment = ReachingExperiment(world, seed=seed, on_frame=feed)
    errors = {"default, estimated flow": experiment.learn()}
    true, mask = world.true_jacobian(), world.robot_mask()
    errors |= {name: jacobian_error(estimator.jacobian, true, mask) for name, estimator in others.items()}
    reaches = []
    if targets:
        experiment.choose()
        reaches = [experiment.reach(target) for target in experiment.targets(targets)]
    return errors, reaches


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default="arm,planar", help="robots, by comma (default: arm,planar)")
    parser.add_argument("--seeds", default="0,1,2,3,4", help="seeds, by comma (default: 0,1,2,3,4)")
    parser.add_argument("--targets", type=int, default=10, help="targets per world (default: 10)")
    parser.add_argument("--distractor", default="none", help="none, behind or front (default: none)")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    worlds = [(robot, int(seed)) for robot in arguments.robots.split(",") for seed in arguments.seeds.split(",")]
    errors: dict[str, list[JacobianError]] = {}
    reaches: list[MeasuredReach] = []
    rows = []
    with progress("accuracy", len(worlds), unit="world") as bar:
        for robot, seed in worlds:
            of_world, reached = run_world(robot, seed, arguments.targets, arguments.distractor)
            for name, error in of_world.items():
                errors.setdefault(name, []).append(error)
            reaches += reached
            error = of_world["default, estimated flow"]
            worst = max((r.true_error_px for r in reached), default=float("nan"))
            rows.append([robot, str(seed), f"{error.median:.3f}", f"{error.inner_median:.3f}", f"{error.p90:.3f}",
                         f"{of_world['default, exact flow'].median:.3f}", f"{worst:.2f}"])  # fmt: skip
            bar.update()
    header = ["robot", "seed", "J error", "3 px inside", "90 %", "exact flow", "worst reach [px]"]
    print(table(header, rows))
    metrics = []
    for name, values in errors.items():
        for part in ("median", "inner_median"):
            found = [getattr(value, part) for value in values]
            metrics.append(Metric(f"J error, {name}, {part}: mean", float(np.mean(found)), "1", "lower"))
            metrics.append(Metric(f"J error, {name}, {part}: worst", float(np.max(found)), "1", "lower"))
    return report([*metrics, *reach_metrics(reaches)], arguments)


def reach_metrics(reaches: list[MeasuredReach]) -> list[Metric]:
    """How many reaches ended below 2 px by the truth, how far off they were, and how long they took."""
    if not reaches:
        return []
    true_errors = np.array([r.true_error_px for r in reaches])
    share = float((true_errors < REACHED_PX).mean())
    return [
        Metric("reaches", len(reaches), "1", "higher"),
        Metric(f"reaches below {REACHED_PX:g} px", share, "1", "higher", 0.05),
        Metric("reach error, median", float(np.median(true_errors)), "px", "lower"),
        Metric("reach error, worst", float(true_errors.max()), "px", "lower", 1.0),
        Metric("reach frames, median", float(np.median([r.reach.frames for r in reaches])), "frames", "lower"),
    ]


if __name__ == "__main__":
    raise SystemExit(main())
