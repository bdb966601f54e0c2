"""``dense-vs reach``: a simulated robot babbles, learns its dense image Jacobian and reaches image targets."""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from dense_vs.body.self_body import SelfBody
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder, write_json
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.error import JacobianError
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import scaled_size
from dense_vs.point_servo.checkpoint import Checkpoint
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.tracker import Method, TrackerOptions
from dense_vs.recording.video_writer import VideoWriter
from dense_vs.sims.cli.options import add_world_arguments, make_world
from dense_vs.view.panels import ReachView
from dense_vs.view.plots import plot_reach
from dense_vs.view.progress import progress
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

if TYPE_CHECKING:
    from dense_vs.sims.engine.depth_camera import SimDepthCamera
    from dense_vs.sims.engine.world import SimWorld
    from dense_vs.sims.papers.dije.reaching import MeasuredReach, ReachingExperiment

LONGEST = 1e5  # s of babbling, more than a day
AGAIN = 3.0  # s of babbling after a restart: the point's link is found by motion that this process has seen


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for reach.mp4, reach.png and summary.json"
    )
    parser.add_argument(
        "--targets", type=int, default=5, metavar="N", help="number of random targets that it can reach (default: 5)"
    )
    parser.add_argument(
        "--babble", type=float, default=10.0, metavar="S", help="seconds of motor babbling first (default: 10)"
    )
    parser.add_argument(
        "--point",
        default="tip",
        metavar="NAME|X,Y",
        help="point to control: a site, body or geom of the model, or X,Y in pixels (default: tip)",
    )
    parser.add_argument(
        "--max-frames", type=int, default=600, metavar="N", help="frames after which a reach is given up (default: 600)"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=1.0,
        metavar="PX",
        help="distance from a target that counts as there. To be called reached, a point's place has to be known to "
        "twice that, or 2 px where that is more (default: 1)",
    )
    parser.add_argument("--gain", type=float, default=0.2, metavar="K", help="gain k_p of DIJE (17) (default: 0.2)")
    parser.add_argument(
        "--flow",
        default="lucas-kanade",
        metavar="METHOD",
        help="optical flow: lucas-kanade, dis, dis-medium, learned, farneback and others (default: lucas-kanade)",
    )
    _add_tracker_arguments(parser)
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        metavar="X",
        help="factor on the images' size, one over a whole number (default: 1)",
    )
    parser.add_argument(
        "--range",
        type=float,
        default=0.8,
        metavar="SHARE",
        help="share of the joints' range that targets are drawn from, 0 to 1 (default: 0.8)",
    )
    parser.add_argument(
        "--depth",
        action="store_true",
        help="with a depth camera as RGB-D cameras are, noisy and with holes: targets are places in space",
    )
    parser.add_argument("--no-video", action="store_true", help="do not draw the video")
    parser.add_argument(
        "--checkpoint",
        type=Path,
        metavar="FILE",
        help="keep what is learned in FILE every 3 s; where FILE is there already, go on from it and babble only as "
        f"long as is left of --babble, at least {AGAIN:g} s",
    )
    add_world_arguments(parser)


def _add_tracker_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--tracker",
        default="link",
        metavar="METHOD",
        help="how the point is followed: link, by its whole rigid link; aligned, fixed_point, or paper, DIJE (15) "
        "(default: link)",
    )
    parser.add_argument(
        "--window", type=int, default=25, metavar="PX", help="side of the patches that are followed, odd (default: 25)"
    )
    parser.add_argument(
        "--min-correlation",
        type=float,
        default=0.85,
        metavar="C",
        help="of the tracker aligned: least correlation at which a patch counts as seen (default: 0.85)",
    )
    parser.add_argument(
        "--lost-after",
        type=int,
        default=15,
        metavar="N",
        help="frames without sight of it after which a point counts as lost (default: 15)",
    )


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.sims.engine.world import FRAME_SECONDS
    from dense_vs.sims.papers.dije.reaching import ReachingExperiment

    _check_numbers(arguments)
    tracker = _tracker_options(arguments)
    point = _point(arguments.point)
    started = time.perf_counter()
    world = make_world(arguments)
    if isinstance(point, str):
        _check_point(world, point)
    size = scaled_size((arguments.height, arguments.width), arguments.scale)
    out = output_folder(arguments.out)
    view = ReachView(world.joint_names)
    checkpoint = None if arguments.checkpoint is None else Checkpoint(arguments.checkpoint, world.joint_names)
    known, learned_before = _known(arguments, checkpoint, world, size)
    babble = arguments.babble if not learned_before else max(arguments.babble - learned_before, AGAIN)
    writer = nullcontext() if arguments.no_video else VideoWriter(out / "reach.mp4", 1 / FRAME_SECONDS)
    count: Callable[[], None] | None = None  # a frame of babbling; how many a reach takes nobody knows
    with writer as video, SelfBody(device=arguments.device, threads=arguments.threads) as body:

        def after_frame(experiment: ReachingExperiment) -> None:
            if count is not None:
                count()
            if checkpoint is not None:
                checkpoint.keep(experiment.loop, learned_before + len(experiment.trace.times) * FRAME_SECONDS)
            if video is not None:
                video.write(view.draw(experiment.loop))

        experiment = ReachingExperiment(
            world,
            camera=_depth_camera(arguments, world),
            point=point,
            seed=arguments.seed,
            babble_seconds=babble,
            scale=arguments.scale,
            on_frame=after_frame,
            body=body,
            **known,
            servo=_servo(arguments, world),
            flow=FlowEstimator(arguments.flow, *size),
        )
        with progress("babble", round(babble / FRAME_SECONDS)) as bar:
            count = bar.update
            learned = experiment.learn()
            count = None
        experiment.choose(**tracker)
        end = {"tolerance": arguments.tolerance, "max_frames": arguments.max_frames}
        targets = experiment.targets(arguments.targets, share_of_range=arguments.range, depth=arguments.depth)
        measured = []
        with progress("reach", len(targets), "target") as bar:
            for target in targets:
                measured.append(experiment.reach(target, **end))
                bar.update()
    seconds = time.perf_counter() - started
    plot_reach(experiment.trace, world.joint_names, out / "reach.png")
    write_json(out / "summary.json", _summary(arguments, experiment, learned, measured, seconds))
    print(_targets_table(measured))
    print(
        f"J error after {learned_before + babble:.4g} s of babbling: {learned.median:.3f} (median over robot pixels), "
        f"{learned.inner_median:.3f} at pixels 3 px inside the outline"
    )
    print(
        f"{_close(measured, arguments.tolerance)}; {len(experiment.trace.times)} frames in {seconds:.1f} s, "
        f"simulation included; results in {out}"
    )
    if checkpoint is not None:
        checkpoint.finish()


def _summary(
    arguments: argparse.Namespace,
    experiment: "ReachingExperiment",
    learned: JacobianError,
    measured: list["MeasuredReach"],
    seconds: float,
) -> dict[str, Any]:
    """What is written to the file of that name."""
    return {
        "targets": [_of_target(m) for m in measured],
        "jacobian_error_median": learned.median,
        "jacobian_error_p90": learned.p90,
        "jacobian_error_inner_median": learned.inner_median,
        "seconds": seconds,
        "fps": len(experiment.trace.times) / seconds,
        "device": str(experiment.loop.estimator.device),
        "seed": arguments.seed,
        "tolerance_px": arguments.tolerance,
        "robot": str(arguments.robot),
        "versions": versions(),
    }


def _check_numbers(arguments: argparse.Namespace) -> None:
    if arguments.targets < 1 or arguments.max_frames < 1:
        raise DenseVSError("--targets and --max-frames are whole numbers of at least 1")
    check_number("--babble", arguments.babble, above=0, most=LONGEST)
    check_number("--gain", arguments.gain, above=0)
    check_number("--tolerance", arguments.tolerance, above=0)
    check_number("--range", arguments.range, above=0, most=1)


def _depth_camera(arguments: argparse.Namespace, world: "SimWorld") -> "SimDepthCamera | None":
    from dense_vs.sims.engine.depth_camera import DepthSensor, SimDepthCamera

    return SimDepthCamera(world, DepthSensor(), seed=arguments.seed) if arguments.depth else None


def _servo(arguments: argparse.Namespace, world: "SimWorld") -> VisualServo:
    joints = len(world.joint_names)
    return VisualServo(joints, joint_limits=world.joint_limits, gain=arguments.gain, seed=arguments.seed)


def _check_point(world: "SimWorld", name: str) -> None:
    """Say what is wrong with a named point before the babbling rather than after it.

    Raises:
        DenseVSError: the model has no such point, or the camera does not see it.
    """
    from dense_vs.sims.engine.image_advice import point_advice

    try:
        pixel = world.project(name)
        seen = world.track_point(pixel)
    except DenseVSError as error:
        raise DenseVSError(f"{error}; --point takes a name or X,Y in pixels, the default is a site 'tip'") from error
    for sentence in point_advice(world, name, seen):
        print(f"note: {sentence}", file=sys.stderr)


def _known(
    arguments: argparse.Namespace, checkpoint: Checkpoint | None, world: "SimWorld", size: tuple[int, int]
) -> tuple[dict[str, Any], float]:
    """Estimator, at the posture of now, and body as a checkpoint has them, and the seconds that they took to learn."""
    where = {"device": arguments.device, "threads": arguments.threads}
    depth = arguments.depth
    kept = None if checkpoint is None else checkpoint.resume(size, **where)
    if kept is None:
        height, width = size
        joints = len(world.joint_names)
        new = DenseJacobian(height=height, width=width, joints=joints, on_bad_flow="skip", depth=depth, **where)
        return {"estimator": new}, 0.0
    if kept.estimator.options.depth != depth:
        has = "with" if kept.estimator.options.depth else "without"
        raise DenseVSError(f"{arguments.checkpoint} was learned {has} depth; expected the same, or another file")
    kept.bring_to(world.joints()[0])
    body = "" if kept.body is None else ", with its body"
    print(f"going on from {arguments.checkpoint}, learned in {kept.seconds:.1f} s of motion{body}")
    return {"estimator": kept.estimator, "body_model": kept.body or True}, kept.seconds


def _tracker_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Options of :meth:`ServoLoop.define_point`; wrong ones are refused here, not after the babbling."""
    methods = ("link", *get_args(Method))
    if arguments.tracker not in methods:
        raise DenseVSError(f"--tracker is {arguments.tracker!r}; expected one of {', '.join(methods)}")
    options = {
        "window": arguments.window,
        "min_correlation": arguments.min_correlation,
        "lost_after": arguments.lost_after,
    }
    TrackerOptions(**options)
    return {"method": arguments.tracker, **options}


def _of_target(measured: "MeasuredReach") -> dict[str, Any]:
    """A reach as the summary holds it."""
    reach = measured.reach
    return {
        "target": list(reach.target),
        "steps": reach.frames,
        "estimated_error_px": reach.error_px,
        "uncertainty_px": reach.uncertainty_px,
        "true_error_px": measured.true_error_px,
        "true_error_m": measured.true_error_m,
        "reached": reach.reached,
        "lost": reach.lost,
        "jacobian_error_median": measured.jacobian.median,
    }


def _close(measured: "Sequence[MeasuredReach]", tolerance: float) -> str:
    """How many targets the point is at by the truth, which leaves as much for what is not known as for the loop."""
    near = 2 * max(tolerance, 1.0)
    return f"{sum(m.true_error_px < near for m in measured)} of {len(measured)} targets within {near:g} px (true error)"


def _targets_table(measured: "Sequence[MeasuredReach]") -> str:
    rows = [
        [
            f"{m.reach.target[0]:.0f}, {m.reach.target[1]:.0f}",
            *(f"{depth:.3f}" for depth in m.reach.target[2:]),
            str(m.reach.frames),
            f"{m.reach.error_px:.2f}",
            "" if m.reach.uncertainty_px is None else f"{m.reach.uncertainty_px:.2f}",
            f"{m.true_error_px:.2f}",
            *(f"{1e3 * m.true_error_m:.1f}" for _ in m.reach.target[2:]),
            f"{m.jacobian.median:.3f}",
            "lost" if m.reach.lost else "yes" if m.reach.reached else "no",
        ]
        for m in measured
    ]
    spatial = any(len(m.reach.target) == 3 for m in measured)
    depth, in_space = (["depth [m]"], ["in space [mm]"]) if spatial else ([], [])
    errors = ["estimated error [px]", "known to [px]", "TRUE error [px]", *in_space, "J error"]
    return table(["target [px]", *depth, "steps", *errors, "reached"], rows)


def _point(text: str) -> str | np.ndarray:
    """A name, or the two numbers of "X,Y"."""
    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        return text
    if place.shape != (2,) or not np.isfinite(place).all():
        raise DenseVSError(f"--point is {text!r}; expected a name or X,Y")
    return place
