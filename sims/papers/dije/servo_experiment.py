"""Common part of the servo experiments of DIJE section V-B: a robot that learns J, then brings points to targets.

As in the paper, images come at 30 frames a second and a joint command every 0.7 s. Unlike the paper's robot, which
began with J = 0 and the control law, ours babbles first: DIJE (17) commands nothing where J is zero. With muscle-like
joints, which are read with noise, J moves by the measured flow, DIJE (13), else by the predicted one, DIJE (14). The
loop sees images and joint readings only; the simulator chooses targets that can be reached and measures the result.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.dije.labeling_arguments import LONGEST
from dense_vs.sims.papers.dije.servo_record import ServoTask, TaskReach, TaskRun
from dense_vs.sims.papers.rows import Row

PAPER_GAIN, PAPER_PERIOD = 0.034, 0.7
HEIGHT, WIDTH = 240, 320  # px, of the images that are worked on
# Arm and tools turn in depth between targets. The paper has no body model; a tool in both hands is no tree of joints.
FOLLOWING: dict[str, Any] = {"renew_patch": 0.93, "body_model": False}
MOST_COMMANDS = 1_000_000
EDGE = 16.0  # px; half the tracker's window and a little


def add_task_arguments(parser: argparse.ArgumentParser, task: ServoTask) -> None:
    """Declare the arguments that the three experiments share."""
    parser.add_argument(
        "--targets",
        nargs="+",
        default=["2"],
        metavar="N|X,Y",
        help="number of random reachable targets for each point (default: 2), or the targets themselves [px]",
    )
    parser.add_argument("--babble", type=float, default=20.0, metavar="S", help="seconds of learning (default: 20)")
    parser.add_argument(
        "--period", type=float, default=PAPER_PERIOD, metavar="S", help="seconds between commands (default: 0.7)"
    )
    parser.add_argument(
        "--gain", type=float, default=0.5, metavar="K", help="k_p of DIJE (17) (default: 0.5; the paper's is 0.034)"
    )
    parser.add_argument(
        "--commands", type=int, default=20, metavar="N", help="commands after which a target is given up (default: 20)"
    )
    parser.add_argument("--compliance", action="store_true", help="muscle-like joints: soft, late, read with noise")
    parser.add_argument(
        "--prediction",
        choices=("model", "flow"),
        help="J moves with the flow that it predicts, DIJE (14), or with the measured one, DIJE (13) (default: model; "
        "flow with --compliance)",
    )
    parser.add_argument(
        "--distractor", default="none", metavar="NAME", help="what passes by, as walker-behind (default: none)"
    )
    parser.add_argument(
        "--halve",
        action="store_true",
        help="render 640 x 480 and halve the images, as the paper; else render 320 x 240, which is faster",
    )
    parser.set_defaults(task=task)


def run_task(arguments: argparse.Namespace) -> list[Row]:
    """Run the task of the arguments for every seed, draw it, and return its rows."""
    from dense_vs.sims.engine.world import FRAME_SECONDS
    from dense_vs.view.progress import progress

    task: ServoTask = arguments.task
    targets = parse_targets(arguments.targets)
    check_number("--babble", arguments.babble, above=0, most=LONGEST)
    check_number("--period", arguments.period, above=0, most=LONGEST)
    check_whole("--commands", arguments.commands, least=1, most=MOST_COMMANDS)
    count = targets if isinstance(targets, int) else len(targets)
    frames = arguments.babble / FRAME_SECONDS + 200 * count * len(task.points)
    runs = []
    with progress("seed", round(frames * len(arguments.seeds))) as bar:
        for seed in arguments.seeds:
            bar.set_description(f"seed {seed}")
            run = run_seed(task, seed, targets, arguments, bar.update)
            draw_task(task, run, arguments.out)
            runs.append(run)
    return task_rows(task, runs, arguments)


def draw_task(task: ServoTask, run: TaskRun, out: Path) -> None:
    """Write ``seedN_images.png``, ``seedN_jacobian.png`` and ``seedN_time.png``."""
    from dense_vs.sims.papers.dije.label_pictures import write_image
    from dense_vs.sims.papers.dije.path_pictures import jacobian_columns, path_images
    from dense_vs.sims.papers.dije.time_plot import plot_over_time

    write_image(out / f"seed{run.seed}_images.png", path_images(run), scale=1)
    write_image(out / f"seed{run.seed}_jacobian.png", jacobian_columns(task, run), scale=1)
    plot_over_time(task, run, out / f"seed{run.seed}_time.png")


def run_seed(
    task: ServoTask,
    seed: int,
    targets: int | np.ndarray,
    arguments: argparse.Namespace,
    on_frame: Callable[[], Any] = lambda: None,
) -> TaskRun:
    """One robot: learn J, then every point to its targets."""
    from dense_vs.jacobian.estimator import DenseJacobian
    from dense_vs.point_servo.law import VisualServo
    from dense_vs.sims.engine.world import FRAME_SECONDS, SimWorld
    from dense_vs.sims.papers.dije.reaching import ReachingExperiment

    world = SimWorld(
        task.robot,
        joints=task.joints,
        seed=seed,
        compliance=arguments.compliance,
        distractor=arguments.distractor,
        device=arguments.device,
        threads=arguments.threads,
        height=HEIGHT * (1 + arguments.halve),
        width=WIDTH * (1 + arguments.halve),
    )
    joints = len(task.joints)
    frames = round(arguments.period / FRAME_SECONDS)
    experiment = ReachingExperiment(
        world,
        point=task.points[0],
        seed=seed,
        babble_seconds=arguments.babble,
        command_seconds=arguments.period,
        command_period=arguments.period,
        scale=0.5 if arguments.halve else 1.0,
        **FOLLOWING,
        on_frame=lambda _: on_frame(),
        estimator=DenseJacobian(
            height=HEIGHT,
            width=WIDTH,
            joints=joints,
            device=arguments.device,
            threads=arguments.threads,
            on_bad_flow="skip",
            # Noise in the joint steps makes J too small, and by DIJE (14) a J that is too small falls behind its
            # surface and gets smaller still: tips of tools then swing about their target. DIJE (13) does not use J.
            prediction=arguments.prediction or ("flow" if arguments.compliance else "model"),
        ),
        # A step lasts 0.7 s instead of a frame, so it may be longer.
        servo=VisualServo(
            joints, joint_limits=world.joint_limits, seed=seed, gain=arguments.gain, max_step=0.12, dither=0.001
        ),
    )
    run = TaskRun(seed, experiment.learn(), experiment.trace)
    for point in task.points:
        place = experiment.project(point)
        seen = well_inside(place, experiment.project(task.points[0]), (HEIGHT, WIDTH))
        run.moved_into_view += int(np.any(seen != place))
        experiment.choose(seen)
        if isinstance(targets, int):
            places = experiment.targets(targets, reach=0.35, least_distance=task.least_distance, border=25.0)
        else:
            places = targets
        for target in places:
            first = len(run.trace.times)
            measured = experiment.reach(target, settle_frames=frames + 5, max_frames=arguments.commands * frames)
            run.reaches.append(
                TaskReach(
                    point,
                    measured.reach.target,
                    measured.reach.frames,
                    measured.true_error_px,
                    measured.reach.lost,
                    experiment.loop.frame.image.copy(),
                    (first, len(run.trace.times) - 1),
                )
            )
    run.estimated = experiment.loop.estimator.to_numpy().copy()
    run.true, run.mask = experiment.truth()
    return run


def well_inside(place: np.ndarray, other: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A point [px], or where it is too near the border to be followed, the nearest place on the way to another point.

    That is what an experimenter would click on. The point itself where the other one is no help.
    """
    low, high = np.full(2, EDGE), np.array(shape[::-1]) - 1 - EDGE
    for share in np.linspace(0.0, 0.6, 31):
        seen = place + share * (other - place)
        if np.all(seen >= low) and np.all(seen <= high):
            return seen
    return place


def task_rows(task: ServoTask, runs: list[TaskRun], arguments: argparse.Namespace) -> list[Row]:
    """The figures of all seeds."""
    seeds = tuple(run.seed for run in runs)
    close = task.soft_px if arguments.compliance else task.close_px
    rows = [
        Row("seconds between commands", PAPER_PERIOD, arguments.period, "s", seeds),
        Row("gain of a command", PAPER_GAIN, arguments.gain, "", seeds),
        Row("J error after learning, median", None, float(np.median([run.learned.median for run in runs])), "", seeds),
    ]
    if len(task.points) > 1:
        moved = float(sum(run.moved_into_view for run in runs))
        rows.append(Row("points near the border, taken farther inside", None, moved, f"of {len(runs)}", seeds))
    for point in task.points:
        reaches = [reach for run in runs for reach in run.reaches if reach.point == point]
        errors = np.array([reach.true_error_px for reach in reaches])
        seconds = np.array([reach.frames for reach in reaches]) / 30
        rows += [
            Row(f"{point}: true error, median", None, float(np.median(errors)), "px", seeds),
            Row(f"{point}: true error, worst", None, float(errors.max()), "px", seeds),
            Row(f"{point}: targets within {close:g} px", None, int((errors < close).sum()), f"of {len(errors)}", seeds),
            Row(f"{point}: reaches given up as lost", None, sum(r.lost for r in reaches), f"of {len(errors)}", seeds),
            Row(f"{point}: time to a target, median", None, float(np.median(seconds)), "s", seeds),
        ]
    return rows


def parse_targets(texts: list[str]) -> int | np.ndarray:
    """A number of random targets, or targets (K, 2) [px] out of ``X,Y`` each.

    Raises:
        DenseVSError: neither.
    """
    if len(texts) == 1 and texts[0].isdecimal() and int(texts[0]) > 0:
        return int(texts[0])
    try:
        places = np.array([[float(part) for part in text.split(",")] for text in texts])
    except ValueError:
        places = np.empty((0, 0))
    if places.shape != (len(texts), 2) or not np.isfinite(places).all():
        raise DenseVSError(
            f"--targets is {' '.join(texts)}; expected a whole number of at least 1, or X,Y of each target"
        )
    return places
