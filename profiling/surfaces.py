"""J, labels and reaches on commercial arms as they come, clean and with a real camera's faults, beside our own arm.

    dense-vs arms panda ur5e baxter fetch
    python profiling/surfaces.py [--arms panda,ur5e] [--cameras A,B] [--images clean,real] [--json FILE]

Each arm babbles as ``dense-vs reach`` does, all with the same default settings, then goes to targets over its whole
range. J by exact flow stands beside the estimate, as what is left is the flow's share. A reach counts where the true
point ends below 2 px; a wrong "reached" is one that the loop believes in and that does not count.
"""

import argparse
from dataclasses import dataclass

import numpy as np
import warp as wp
from metrics import Metric, add_report_arguments, report

from dense_vs.body import SelfBody
from dense_vs.jacobian import DenseJacobian
from dense_vs.jacobian.error import JacobianError, jacobian_error
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.built_scenes import ARM_NAMES
from dense_vs.sims.papers.dije.reaching import MeasuredReach, ReachingExperiment
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

REACHED_PX = 2.0


@dataclass(frozen=True)
class SurfaceResult:
    """One arm before one camera."""

    name: str
    images: str
    jacobian: JacobianError
    exact: JacobianError
    overlap: float  # of labels and true robot, intersection over union
    precision: float
    recall: float
    delay_frames: float  # of the joint readings, as found
    reaches: list[MeasuredReach]

    @property
    def reached(self) -> int:
        """Reaches that truly ended at their target."""
        return sum(reach.true_error_px < REACHED_PX for reach in self.reaches)

    @property
    def wrongly_reached(self) -> int:
        """Reaches that the loop believes in wrongly."""
        return sum(reach.reach.reached and reach.true_error_px >= REACHED_PX for reach in self.reaches)


def measure(arm: str, camera: str, images: str, options: argparse.Namespace) -> SurfaceResult:
    """Babble, compare J and labels with the truth, reach."""
    world = make_world(arm, camera, images == "real", options)
    size = {"height": world.shape[1], "width": world.shape[2], "joints": len(world.joint_names)}
    exact = DenseJacobian(**size, device=options.device)
    last = world.joints()[0] if images == "clean" else None

    def feed(experiment: ReachingExperiment) -> None:
        nonlocal last
        if last is None or experiment.surface_point is not None:
            return
        present = world.joints()[0]
        exact.update(world.true_flow(), present - last)
        last = present

    with SelfBody(device=options.device) as body:
        experiment = ReachingExperiment(
            world, seed=options.seed, babble_seconds=options.seconds, on_frame=feed, device=options.device, body=body
        )
        found = experiment.learn()
        true, mask = experiment.truth()
        labels = experiment.loop.pipeline.labels() == 1
        by_exact = jacobian_error(exact.jacobian, true, mask)
        reaches = []
        if options.targets:
            experiment.choose()
            reaches = [experiment.reach(target) for target in experiment.targets(options.targets)]
    overlap, precision, recall = label_quality(labels, mask)
    return SurfaceResult(
        name=f"{arm} {camera}".strip(),
        images=images,
        jacobian=found,
        exact=by_exact,
        overlap=overlap,
        precision=precision,
        recall=recall,
        delay_frames=experiment.loop.joint_delay * 30,
        reaches=reaches,
    )


def label_quality(labels: np.ndarray, mask: np.ndarray) -> tuple[float, float, float]:
    """Intersection over union, precision and recall of labels against the true robot, bool ``(H, W)`` each."""
    both = float((labels & mask).sum())
    return both / max(1, (labels | mask).sum()), both / max(1, labels.sum()), both / max(1, mask.sum())


def make_world(arm: str, camera: str, realism: bool, options: argparse.Namespace) -> SimWorld:
    """The arm's world with its first joints; ours have one camera and all of theirs."""
    if arm not in ARM_NAMES:
        return SimWorld(arm, seed=options.seed, realism=realism, device=options.device)
    names = SimWorld(arm, camera=camera, device=options.device, height=8, width=8).joint_names
    return SimWorld(
        arm,
        joints=names[: options.joints],
        camera=camera,
        seed=options.seed,
        realism=realism,
        device=options.device,
    )


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", default=",".join([*ARM_NAMES, "arm"]), help="by comma (default: all and our own)")
    parser.add_argument("--cameras", default="A,B", help="of the commercial arms, by comma (default: A,B)")
    parser.add_argument("--images", default="clean,real", help="clean, real or both, by comma (default: clean,real)")
    parser.add_argument("--joints", type=int, default=4, help="of the commercial arms, from the base (default: 4)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of babbling (default: 10)")
    parser.add_argument("--targets", type=int, default=5, help="of each arm and camera (default: 5)")
    parser.add_argument("--seed", type=int, default=0, help="of motion and targets (default: 0)")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    add_report_arguments(parser)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    cases = [
        (arm, camera, images)
        for images in options.images.split(",")
        for arm in options.arms.split(",")
        for camera in (options.cameras.split(",") if arm in ARM_NAMES else [""])
    ]
    results = []
    with progress("surfaces", len(cases), unit="arm") as bar:
        for arm, camera, images in cases:
            results.append(measure(arm, camera, images, options))
            bar.update()
    print_results(results)
    return report(metrics_of(results), options)


def print_results(results: list[SurfaceResult]) -> None:
    """A line an arm and camera."""
    header = ["arm, camera", "images", "J error", "90 %", "exact flow", "label IoU", "precision", "recall",
              "delay found", f"below {REACHED_PX:g} px", "wrong"]  # fmt: skip
    rows = [
        [r.name, r.images, f"{r.jacobian.median:.3f}", f"{r.jacobian.p90:.2f}",
         f"{r.exact.median:.3f}" if r.images == "clean" else "", f"{r.overlap:.2f}", f"{r.precision:.2f}",
         f"{r.recall:.2f}", f"{r.delay_frames:.2f}", f"{r.reached} of {len(r.reaches)}", str(r.wrongly_reached)]
        for r in results
    ]  # fmt: skip
    print(table(header, rows))


def metrics_of(results: list[SurfaceResult]) -> list[Metric]:
    """Every figure by arm, and the means over the commercial ones."""
    metrics = []
    for r in results:
        name = f"{r.name}, {r.images}"
        metrics.append(Metric(f"{name}: J error", r.jacobian.median, "1", "lower"))
        metrics.append(Metric(f"{name}: label IoU", r.overlap, "1", "higher"))
        if r.reaches:
            metrics.append(Metric(f"{name}: reaches below {REACHED_PX:g} px", r.reached, "reaches", "higher"))
            metrics.append(Metric(f"{name}: wrongly reached", r.wrongly_reached, "reaches", "lower"))
    for images in dict.fromkeys(r.images for r in results):
        arms = [r for r in results if r.images == images and r.name.split()[0] in ARM_NAMES]
        if not arms:
            continue
        errors = [r.jacobian.median for r in arms]
        metrics += [
            Metric(f"J error, {images}: mean over arms", float(np.mean(errors)), "1", "lower"),
            Metric(f"J error, {images}: worst arm", float(np.max(errors)), "1", "lower"),
            Metric(f"label IoU, {images}: mean over arms", float(np.mean([r.overlap for r in arms])), "1", "higher"),
            Metric(f"reaches, {images}", sum(len(r.reaches) for r in arms), "reaches", "higher"),
            Metric(f"reaches below {REACHED_PX:g} px, {images}", sum(r.reached for r in arms), "reaches", "higher"),
            Metric(f"wrongly reached, {images}", sum(r.wrongly_reached for r in arms), "reaches", "lower"),
        ]
    return metrics


if __name__ == "__main__":
    raise SystemExit(main())
