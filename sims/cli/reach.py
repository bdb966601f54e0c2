"""``dense-vs reach``: a simulated robot babbles, learns its dense image Jacobian and reaches image targets."""

import argparse
import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder, write_json
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.tracker import TrackerOptions
from dense_vs.recording.video_writer import VideoWriter
from dense_vs.sims.cli.options import add_world_arguments, make_world
from dense_vs.view.panels import ReachView
from dense_vs.view.plots import plot_reach
from dense_vs.view.progress import progress
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

if TYPE_CHECKING:
    from dense_vs.sims.papers.dije.reaching import MeasuredReach

REACHED_PX = 2.0
LONGEST = 1e5  # s of babbling, more than a day


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
        "--max-frames", type=int, default=150, metavar="N", help="frames after which a reach is given up (default: 150)"
    )
    parser.add_argument("--gain", type=float, default=0.2, metavar="K", help="gain k_p of DIJE (17) (default: 0.2)")
    parser.add_argument(
        "--flow",
        default="lucas-kanade",
        metavar="METHOD",
        help="optical flow: lucas-kanade, dis, dis-medium, learned, farneback and others (default: lucas-kanade)",
    )
    parser.add_argument(
        "--tracker",
        default="aligned",
        metavar="METHOD",
        help="aligned, fixed_point, or paper, DIJE (15) (default: aligned)",
    )
    parser.add_argument("--no-video", action="store_true", help="do not draw the video")
    add_world_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.sims.engine.world import FRAME_SECONDS
    from dense_vs.sims.papers.dije.reaching import ReachingExperiment

    if arguments.targets < 1 or arguments.max_frames < 1:
        raise DenseVSError("--targets and --max-frames are whole numbers of at least 1")
    check_number("--babble", arguments.babble, above=0, most=LONGEST)
    check_number("--gain", arguments.gain, above=0)
    TrackerOptions(method=arguments.tracker)  # wrong here, not after the babbling
    point = _point(arguments.point)
    started = time.perf_counter()
    world = make_world(arguments)
    if isinstance(point, str):
        world.project(point)
    size = {"height": arguments.height, "width": arguments.width}
    joints = len(world.joint_names)
    out = output_folder(arguments.out)
    view = ReachView(world.joint_names)
    total = round(arguments.babble / FRAME_SECONDS) + 30 * arguments.targets
    writer = nullcontext() if arguments.no_video else VideoWriter(out / "reach.mp4", 1 / FRAME_SECONDS)
    with writer as video, progress("babble", total) as bar:

        def after_frame(experiment: ReachingExperiment) -> None:
            bar.update()
            if video is not None:
                video.write(view.draw(experiment.loop))

        experiment = ReachingExperiment(
            world,
            point=point,
            seed=arguments.seed,
            babble_seconds=arguments.babble,
            on_frame=after_frame,
            estimator=DenseJacobian(
                **size, joints=joints, device=arguments.device, threads=arguments.threads, on_bad_flow="skip"
            ),
            servo=VisualServo(joints, joint_limits=world.joint_limits, gain=arguments.gain, seed=arguments.seed),
            flow=FlowEstimator(arguments.flow, **size),
        )
        learned = experiment.learn()
        experiment.choose(method=arguments.tracker)
        targets = experiment.targets(arguments.targets)
        measured = []
        for number, target in enumerate(targets):
            bar.set_description(f"target {number + 1} of {len(targets)}")
            measured.append(experiment.reach(target, max_frames=arguments.max_frames))
    seconds = time.perf_counter() - started
    plot_reach(experiment.trace, world.joint_names, out / "reach.png")
    summary = {
        "targets": [_of_target(m) for m in measured],
        "jacobian_error_median": learned.median,
        "jacobian_error_p90": learned.p90,
        "jacobian_error_inner_median": learned.inner_median,
        "seconds": seconds,
        "fps": len(experiment.trace.times) / seconds,
        "device": str(experiment.loop.estimator.device),
        "seed": arguments.seed,
        "robot": str(arguments.robot),
        "versions": versions(),
    }
    write_json(out / "summary.json", summary)
    print(_targets_table(measured))
    close = sum(m.true_error_px < REACHED_PX for m in measured)
    print(
        f"J error after {arguments.babble:g} s of babbling: {learned.median:.3f} (median over robot pixels), "
        f"{learned.inner_median:.3f} at pixels 3 px inside the outline"
    )
    print(
        f"{close} of {len(measured)} targets within {REACHED_PX:g} px (true error); "
        f"{len(experiment.trace.times)} frames in {seconds:.1f} s, simulation included; results in {out}"
    )


def _of_target(measured: "MeasuredReach") -> dict[str, Any]:
    """A reach as the summary holds it."""
    reach = measured.reach
    return {
        "target": list(reach.target),
        "steps": reach.frames,
        "estimated_error_px": reach.error_px,
        "true_error_px": measured.true_error_px,
        "reached": reach.reached,
        "lost": reach.lost,
        "jacobian_error_median": measured.jacobian.median,
    }


def _targets_table(measured: "Sequence[MeasuredReach]") -> str:
    rows = [
        [
            f"{m.reach.target[0]:.0f}, {m.reach.target[1]:.0f}",
            str(m.reach.frames),
            f"{m.reach.error_px:.2f}",
            f"{m.true_error_px:.2f}",
            f"{m.jacobian.median:.3f}",
            "lost" if m.reach.lost else "yes" if m.reach.reached else "no",
        ]
        for m in measured
    ]
    return table(["target [px]", "steps", "estimated error [px]", "TRUE error [px]", "J error", "reached"], rows)


def _point(text: str) -> str | np.ndarray:
    """A name, or the two numbers of "X,Y"."""
    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        return text
    if place.shape != (2,) or not np.isfinite(place).all():
        raise DenseVSError(f"--point is {text!r}; expected a name or X,Y")
    return place
