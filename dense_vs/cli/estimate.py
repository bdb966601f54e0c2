"""``dense-vs estimate``: the dense image Jacobian of a recorded robot, from a video and a joint log."""

import argparse
import time
from pathlib import Path

from dense_vs.errors import DenseVSError
from dense_vs.files import write_json
from dense_vs.view.progress import progress
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

HELP = "estimate the dense image Jacobian from a video and a joint log"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    from dense_vs.cli.options import add_device_arguments

    parser.add_argument("video", type=Path, help="video file, any that OpenCV reads")
    parser.add_argument("joints", type=Path, help="CSV file: time [s] first, then one named joint [rad] a column")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--joints", dest="joint_names", metavar="A,B,C", help="joints of the log to use (default: all)")
    parser.add_argument(
        "--time-offset",
        type=float,
        default=0.0,
        metavar="S",
        help="seconds to add to the log's times to bring them onto the video's clock (default: 0)",
    )
    parser.add_argument(
        "--scale", type=float, default=1.0, help="factor on the image size, 0.5 in the paper (default: 1)"
    )
    parser.add_argument(
        "--every", type=int, default=150, metavar="FRAMES", help="save J every so many frames (default: 150)"
    )
    parser.add_argument("--flow", default="dis", metavar="METHOD", help="optical flow method (default: dis)")
    parser.add_argument(
        "--covariance", default="shared", help="shared, diagonal (the paper's), fixed or full (default: shared)"
    )
    parser.add_argument("--prediction", default="model", help="model (14), flow (13) or none (default: model)")
    parser.add_argument("--no-video", action="store_true", help="do not draw the visualisation video")
    parser.add_argument(
        "--truth", type=Path, metavar="NPZ", help="true Jacobians that 'dense-vs record' wrote; prints the error"
    )
    add_device_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from contextlib import nullcontext

    from dense_vs.files import output_folder
    from dense_vs.jacobian.error import jacobian_error
    from dense_vs.pipeline.recorded import estimate_recording
    from dense_vs.recording.truth_file import TruthFile
    from dense_vs.recording.video import VideoWriter
    from dense_vs.recording.video_recording import Recording
    from dense_vs.view.panels import JacobianView, as_rgb, label, tile

    if arguments.every < 1:
        raise DenseVSError(f"--every is {arguments.every}; expected a whole number of at least 1")
    names = arguments.joint_names.split(",") if arguments.joint_names else None
    recording = Recording(
        arguments.video,
        arguments.joints,
        joint_names=names,
        time_offset=arguments.time_offset,
    )
    truth = TruthFile.read(arguments.truth, recording.log.names) if arguments.truth else None
    out = output_folder(arguments.out)
    view = JacobianView(recording.log.names)
    started = time.perf_counter()
    errors, frames, estimator = [], 0, None
    steps = estimate_recording(
        recording,
        scale=arguments.scale,
        method=arguments.flow,
        device=arguments.device,
        threads=arguments.threads,
        covariance=arguments.covariance,
        prediction=arguments.prediction,
    )
    writer = nullcontext() if arguments.no_video else VideoWriter(out / "estimate.mp4", recording.video.fps)
    with writer as video, progress("estimate", recording.video.frame_count) as bar:
        for frame, estimator in steps:
            frames += 1
            bar.update()
            if frame.flow is None:
                continue
            jacobian = estimator.to_numpy()
            if frames % arguments.every == 0:
                estimator.save(out / f"jacobian_{frames:06d}.npz")
            if truth is not None and (true := truth.at(frame.time, arguments.scale)) is not None:
                errors.append({"time": frame.time, **vars(jacobian_error(jacobian, *true))})
            if video is not None:
                panels = [label(as_rgb(frame.image), f"camera {frame.time:.2f} s"), view.flow(frame.flow, "flow u")]
                panels += [view.flow(estimator.predicted_flow(frame.dq), "predicted flow J dq")]
                panels += view.columns(jacobian)
                video.write(tile(panels, columns=3))
    assert estimator is not None  # estimate() raises where no frame was used
    estimator.save(out / "jacobian.npz")
    seconds = time.perf_counter() - started
    summary = {
        "frames": frames,
        "skipped_frames": recording.skipped_frames,
        "joints": list(recording.log.names),
        "size": [estimator.options.height, estimator.options.width],
        "jacobian_error_median": errors[-1]["median"] if errors else None,
        "jacobian_errors": errors,
        "seconds": seconds,
        "fps": frames / seconds,
        "device": str(estimator.device),
        "versions": versions(),
    }
    write_json(out / "summary.json", summary)
    if truth is not None:
        if not errors:
            raise DenseVSError(
                f"{arguments.truth} has no truth within the estimated frames; it covers {truth.times[0]:.3f} to "
                f"{truth.times[-1]:.3f} s"
            )
        rows = [
            [f"{e['time']:.2f}", f"{e['median']:.3f}", f"{e['p90']:.3f}", f"{e['inner_median']:.3f}"] for e in errors
        ]
        print(table(["time [s]", "J error median", "90 %", "median 3 px inside"], rows))
    print(f"{frames} frames in {seconds:.1f} s, {recording.skipped_frames} outside the joint log; results in {out}")
