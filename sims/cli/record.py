"""``dense-vs record``: a simulated robot's video and joint log, with the truth beside them."""

import argparse
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder
from dense_vs.flow.estimator import FlowEstimator, to_gray
from dense_vs.recording.truth_file import TruthFile
from dense_vs.recording.writers import FORMATS, open_writer, written
from dense_vs.robot.babbling import Babbling
from dense_vs.sims.cli.options import add_world_arguments, make_world
from dense_vs.view.progress import progress

LONGEST, MOST_READINGS = 1e5, 1e7  # s; more than a day, and 80 MB a joint
VIDEO_QUALITY = 3  # compression artifacts are flow errors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for video.mp4, joints.csv and truth.npz"
    )
    parser.add_argument(
        "--format",
        default="video",
        metavar="NAME",
        help="video, lerobot (LeRobot v3.0) or mcap (ROS 2 bag), the last two in DIR/recording (default: video)",
    )
    parser.add_argument(
        "--seconds", type=float, default=20.0, metavar="S", help="length of the recording (default: 20)"
    )
    parser.add_argument(
        "--log-rate", type=float, default=100.0, metavar="HZ", help="rate of the joint log (default: 100)"
    )
    parser.add_argument(
        "--jitter",
        type=float,
        default=0.002,
        metavar="S",
        help="standard deviation of the log's sampling times (default: 0.002)",
    )
    parser.add_argument(
        "--time-offset",
        type=float,
        default=0.0,
        metavar="S",
        help="seconds that the log's clock is behind the video's; give 'dense-vs estimate' the same (default: 0)",
    )
    parser.add_argument(
        "--truth-every", type=int, default=30, metavar="FRAMES", help="frames between truths (default: 30)"
    )
    add_world_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.sims.engine.world import FRAME_SECONDS

    for name, value in (("--seconds", arguments.seconds), ("--log-rate", arguments.log_rate)):
        if not np.isfinite(value) or value <= 0:
            raise DenseVSError(f"{name} is {value}; expected a finite number above 0")
    if arguments.seconds > LONGEST or arguments.seconds * arguments.log_rate > MOST_READINGS:
        raise DenseVSError(
            f"--seconds is {arguments.seconds:g} and --log-rate {arguments.log_rate:g}; expected at most {LONGEST:g} s "
            f"and {MOST_READINGS:g} readings"
        )
    if not 0 <= arguments.jitter < np.inf or not np.isfinite(arguments.time_offset) or arguments.truth_every < 1:
        raise DenseVSError(
            "--jitter and --time-offset are finite seconds, --truth-every is a whole number of at least 1"
        )
    if arguments.format not in FORMATS:
        raise DenseVSError(f"--format is {arguments.format!r}; expected one of {', '.join(FORMATS)}")
    world = make_world(arguments)
    out = output_folder(arguments.out)
    frames = max(2, round(arguments.seconds / FRAME_SECONDS))
    babbling = Babbling(len(world.joint_names), seed=arguments.seed, frame_time=FRAME_SECONDS)
    flow = FlowEstimator(height=arguments.height, width=arguments.width)
    low, high = world.joint_limits.T
    log_times, log_positions = [np.array([world.time])], [world.joints()[0][None]]
    truth_times, truth_jacobians, truth_masks = [], [], []
    image = world.frame().rgb
    gray, last_flow = to_gray(image), None
    folder = out if arguments.format == "video" else out / "recording"
    names = tuple(world.joint_names)
    writer = open_writer(arguments.format, folder, names, fps=1 / FRAME_SECONDS, quality=VIDEO_QUALITY)
    with written(writer), progress("record", frames) as bar:
        writer.add_image(image, world.time)
        bar.update()
        for frame in range(1, frames):
            q = world.joints()[0]
            world.step(np.clip(q + babbling.step(last_flow), low, high) - q)
            times, positions = world.joint_history()
            log_times.append(times)
            log_positions.append(positions)
            image = world.frame().rgb
            previous, gray = gray, to_gray(image)
            last_flow = flow(previous, gray)
            writer.add_image(image, world.time)
            if frame % arguments.truth_every == 0 or frame == frames - 1:
                truth_times.append(world.time)
                truth_jacobians.append(world.true_jacobian())
                truth_masks.append(world.robot_mask())
            bar.update()
        times, positions = np.concatenate(log_times), np.concatenate(log_positions)
        times, positions = _sampled(times, positions, arguments.log_rate, arguments.jitter, arguments.seed)
        for time, row in zip(times - arguments.time_offset, positions, strict=True):
            writer.add_joints(row, time)
    truth = TruthFile(tuple(world.joint_names), np.array(truth_times), np.array(truth_jacobians), np.array(truth_masks))
    truth.write(out / "truth.npz")
    print(f"{frames} frames, {len(times)} joint readings, truth at {len(truth_times)} frames in {out}")


def _sampled(
    times: np.ndarray, positions: np.ndarray, rate: float, jitter: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Readings at about ``rate``, each taken ``jitter`` early or late and stamped when it was taken."""
    random = np.random.default_rng([seed, 11])
    ticks = np.arange(times[0], times[-1], 1 / rate)
    # Half a period at most, so that the readings keep their order.
    shifts = np.clip(random.normal(0.0, jitter, len(ticks)), -0.45 / rate, 0.45 / rate)
    taken = np.clip(ticks + shifts, times[0], times[-1])
    taken[0] = times[0]  # the log covers the whole video
    taken = np.append(taken[np.append(True, np.diff(taken) > 0)], times[-1])
    taken = taken[np.append(True, np.diff(taken) > 0)]
    return taken, np.stack([np.interp(taken, times, column) for column in positions.T], axis=1)
