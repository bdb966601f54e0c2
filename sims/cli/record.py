"""``dense-vs record``: a simulated robot's video and joint log, with the truth beside them."""

import argparse
import csv
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.cli.options import add_world_arguments, make_world
from dense_vs.view.progress import progress

HELP = "record a simulated robot: video, joint log and the true Jacobians"
VIDEO_QUALITY = 3  # compression artefacts are flow errors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--out", type=Path, required=True, help="folder for video.mp4, joints.csv and truth.npz")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the recording (default: 20)")
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
        help="seconds that the log's clock is behind the video's; give estimate the same (default: 0)",
    )
    parser.add_argument(
        "--truth-every", type=int, default=30, metavar="FRAMES", help="frames between truths (default: 30)"
    )
    add_world_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.files import atomic_write, output_folder
    from dense_vs.flow.estimator import FlowEstimator, to_gray
    from dense_vs.recording.truth_file import TruthFile
    from dense_vs.recording.video import VideoWriter
    from dense_vs.robot.babbling import Babbling
    from dense_vs.sims.engine.world import FRAME_SECONDS

    for name, value in (("--seconds", arguments.seconds), ("--log-rate", arguments.log_rate)):
        if not np.isfinite(value) or value <= 0:
            raise DenseVSError(f"{name} is {value}; expected a finite number above 0")
    if not 0 <= arguments.jitter < np.inf or not np.isfinite(arguments.time_offset) or arguments.truth_every < 1:
        raise DenseVSError(
            "--jitter and --time-offset are finite seconds, --truth-every is a whole number of at least 1"
        )
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
    with (
        VideoWriter(out / "video.mp4", 1 / FRAME_SECONDS, quality=VIDEO_QUALITY) as video,
        progress("record", frames) as bar,
    ):
        video.write(image)
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
            video.write(image)
            if frame % arguments.truth_every == 0 or frame == frames - 1:
                truth_times.append(world.time)
                truth_jacobians.append(world.true_jacobian())
                truth_masks.append(world.robot_mask())
            bar.update()
    times, positions = _sampled(
        np.concatenate(log_times), np.concatenate(log_positions), arguments.log_rate, arguments.jitter, arguments.seed
    )
    with atomic_write(out / "joints.csv", "w") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["time", *world.joint_names])
        for time, row in zip(times - arguments.time_offset, positions, strict=True):
            writer.writerow([f"{time:.6f}", *(f"{q:.8f}" for q in row)])
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
