"""A robot before a depth camera: J's row of depth, depth of the robot's pixels, and reaches in image and depth.

    python profiling/depth_row.py [--robot arm] [--seeds 2,3,4,5] [--targets 5] [--images clean] [--json FILE]

The depth camera is noisy, in steps and has holes (``sims/engine/depth_camera.py``). The robot babbles, learning J with
its row of depth and a body model, which some of the depth images bring to meters, and reaches targets in space; all is
compared with the simulator's truth. Then the body model is asked for the depth of the robot's pixels at postures that
it has not seen. The defaults were tuned on the seeds 0 and 1.
"""

import argparse
from dataclasses import asdict, dataclass, field

import numpy as np
import warp as wp
from depth_scores import DepthScore, RowScore, SpaceReach, depth_score, reach_metrics, row_score
from metrics import Metric, add_report_arguments, report
from postures import go_to

from dense_vs.body_model import BodyModel
from dense_vs.jacobian import jacobian_error
from dense_vs.sims import DepthSensor, SimDepthCamera, SimWorld
from dense_vs.sims.papers.dije.reaching import ReachingExperiment
from dense_vs.view.tables import table

KEPT_EVERY = 30  # frames between the depth images that the body model's scale follows from
POSTURES = 8  # unseen ones


@dataclass(frozen=True)
class SeedResult:
    """One robot with one seed.

    Attributes:
        seed: which.
        pixel_rows: median relative error of J's pixel rows after babbling.
        row: of its row of depth.
        sensor: the depth image as it is measured.
        filtered: the estimator's depth.
        model: the body model's at unseen postures, in meters by noisy depth images; NaN where there is no model.
        reaches: in image and depth.
    """

    seed: int
    pixel_rows: float
    row: RowScore
    sensor: DepthScore
    filtered: DepthScore
    model: DepthScore
    reaches: list[SpaceReach] = field(default_factory=list)


def measure(seed: int, options: argparse.Namespace) -> SeedResult:
    """Babble, compare, reach, and ask the body model."""
    world = SimWorld(
        options.robot, seed=seed, device=options.device, realism=False if options.images == "clean" else options.images
    )
    camera = SimDepthCamera(world, DepthSensor(noise=options.noise), seed=seed)
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    frames = [0]

    def keep(experiment: ReachingExperiment) -> None:
        frame = experiment.loop.frame
        frames[0] += 1
        if experiment.surface_point is None and frames[0] % KEPT_EVERY == 0 and frame.depth is not None:
            kept.append((frame.depth, frame.positions))

    experiment = ReachingExperiment(
        world,
        seed=seed,
        babble_seconds=options.seconds,
        camera=camera,
        depth=True,
        device=options.device,
        traced=False,
        on_frame=keep,
    )
    experiment.learn()
    J, robot, exact = world.true_jacobian(True), world.robot_mask(), world.frame().depth
    estimator = experiment.loop.estimator
    result = SeedResult(
        seed,
        jacobian_error(estimator.to_numpy(), J[..., :2, :], robot).median,
        row_score(estimator.depth_jacobian, J[..., 2, :], motion_in_space(J, world, exact), robot),
        depth_score(camera.depth(), exact, robot),
        depth_score(estimator.depth, exact, robot),
        DepthScore(*[float("nan")] * 3),
        reach_all(experiment, options.targets),
    )
    model = experiment.loop.body_model
    if model is not None:
        asked = ask(world, model.in_meters([d for d, _ in kept], np.array([q for _, q in kept])), seed)
        result = SeedResult(**{**vars(result), "model": asked})
    return result


def motion_in_space(J: np.ndarray, world: SimWorld, depth: np.ndarray) -> np.ndarray:
    """Size ``(H, W)`` of the motion of every pixel's point by all joints [m/rad].

    X = Z (x, y, 1) with directions x, y: dX = (dx Z + x dZ, dy Z + y dZ, dZ). The lens is taken for a pinhole's.
    """
    height, width = depth.shape
    directions = world.viewpoint.lens.directions(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1))
    focal = np.diag(world.intrinsics)[:2]
    across = J[..., :2, :] / focal[:, None] * depth[..., None, None]
    across = across + directions[..., None] * J[..., 2:, :]
    return np.linalg.norm(np.concatenate([across, J[..., 2:, :]], axis=2), axis=(2, 3))


def reach_all(experiment: ReachingExperiment, targets: int) -> list[SpaceReach]:
    """Reach targets that the tip can be at."""
    if not targets:
        return []
    experiment.choose()
    point = experiment.surface_point
    assert point is not None
    reaches = []
    for target in experiment.targets(targets, depth=True):
        measured = experiment.reach(target)
        off = float(abs(experiment.loop.point_depth - experiment.in_camera(point)[2]))
        reach = measured.reach
        reaches.append(SpaceReach(reach.end.value, measured.true_error_m, measured.true_error_px, off, reach.frames))
        print(reaches[-1], flush=True)
    return reaches


def ask(world: SimWorld, model: BodyModel, seed: int) -> DepthScore:
    """Depth of the robot's pixels at unseen postures, in the range that the babbling covered."""
    rng = np.random.default_rng([seed, 22])
    low, high = model.joint_range.T
    found, true, masks = [], [], []
    for _ in range(POSTURES):
        go_to(world, rng.uniform(low, high))
        found.append(model.image(world.joints()[0]).depths)
        true.append(world.frame().depth)
        masks.append(world.robot_mask())
    return depth_score(np.stack(found), np.stack(true), np.stack(masks))


def metrics_of(results: list[SeedResult]) -> list[Metric]:
    """Means over the seeds, and the reaches of all together."""

    def mean(name: str, part: str) -> float:
        return float(np.mean([getattr(getattr(result, part), name) for result in results]))

    return [
        Metric("J error, pixel rows", float(np.mean([result.pixel_rows for result in results])), "1", "lower"),
        Metric("J error, row of depth, median", mean("median", "row"), "1", "lower"),
        Metric("J error, row of depth, 90 %", mean("p90", "row"), "1", "lower"),
        Metric("J error, row of depth by the whole motion", mean("of_motion", "row"), "1", "lower"),
        *(
            Metric(f"depth of robot pixels, {text}, {share}", mean(name, part), "1", "lower")
            for part, text in (
                ("sensor", "as measured"),
                ("filtered", "filtered"),
                ("model", "body model at unseen postures"),
            )
            for name, share in (("median", "median"), ("p90", "90 %"), ("unknown", "share not known"))
        ),
        *reach_metrics([reach for result in results for reach in result.reaches]),
    ]


def print_results(results: list[SeedResult]) -> None:
    """A row a seed."""
    header = [
        "seed", "pixel rows", "row of depth", "90 %", "by motion", "depth measured", "filtered", "not known", "model",
        "worst reach [mm]",
    ]  # fmt: skip
    rows = [
        [
            str(r.seed),
            f"{r.pixel_rows:.3f}",
            f"{r.row.median:.3f}",
            f"{r.row.p90:.2f}",
            f"{r.row.of_motion:.3f}",
            f"{r.sensor.median:.4f}",
            f"{r.filtered.median:.4f}",
            f"{r.filtered.unknown:.3f}",
            f"{r.model.median:.4f}",
            f"{max((1e3 * reach.error_m for reach in r.reaches), default=float('nan')):.1f}",
        ]
        for r in results
    ]
    print(table(header, rows))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="arm", help="robot (default: arm)")
    parser.add_argument("--seeds", default="2,3,4,5", help="seeds, by comma (default: 2,3,4,5)")
    parser.add_argument("--targets", type=int, default=5, help="targets a seed (default: 5)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of babbling (default: 10)")
    parser.add_argument("--noise", type=float, default=0.003, help="of the depth camera at 1 m [m] (default: 0.003)")
    parser.add_argument("--images", default="clean", help="clean, realistic or sensor (default: clean)")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    add_report_arguments(parser)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    results = []
    for seed in options.seeds.split(","):
        results.append(measure(int(seed), options))
        print(results[-1], flush=True)
    print_results(results)
    return report(metrics_of(results), options, seeds=[asdict(result) for result in results])


if __name__ == "__main__":
    raise SystemExit(main())
