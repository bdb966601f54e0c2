"""``dense-vs estimate``: the dense image Jacobian of a recorded robot, and how much of the motion it explains.

PATH is a video with a CSV joint log, a LeRobot folder (v2.0, v2.1, v3.0), a ROS 1 or ROS 2 bag, or a folder of images
with a CSV joint log; 'dense-vs info PATH' shows what is in it. Repeated images are joined with their joint steps, the
clocks of camera and joints are aligned by the motion that both have seen, and what to do for a better recording is
said in words.
"""

import argparse
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from dense_vs.body_model import BodyModel, PostureMemory, load_body
from dense_vs.body_model.model_file import FORMAT as CHAIN
from dense_vs.body_model.posture_memory import FORMAT as MEMORY
from dense_vs.checks import check_number, check_whole
from dense_vs.cli.estimate_episodes import episodes_table, estimate_episodes
from dense_vs.cli.options import add_cluster_arguments, add_device_arguments
from dense_vs.cli.recorded_change import find_recorded_change
from dense_vs.cli.recording_options import add_recording_arguments, episode_numbers, open_chosen
from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder, stored_format, write_json
from dense_vs.jacobian.error import jacobian_error
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.jacobian_file import FORMAT as JACOBIAN
from dense_vs.pipeline.body_prior import BodyPrior
from dense_vs.pipeline.explained_motion import share_of_pixels_known
from dense_vs.pipeline.frame_pipeline import scaled_size
from dense_vs.pipeline.recorded import JOINT_SMOOTHING, RecordedEstimate
from dense_vs.recording import ClockOffset, Recording, TruthFile, VideoWriter, survey_episode
from dense_vs.recording.survey import joint_motions, moved_together
from dense_vs.view.advice import advice
from dense_vs.view.panels import JacobianView, as_rgb, label, tile
from dense_vs.view.progress import progress
from dense_vs.view.provenance import versions
from dense_vs.view.recording_report import write_report
from dense_vs.view.rerun_file import RerunFile
from dense_vs.view.tables import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_recording_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument(
        "--episodes",
        metavar="A:B",
        help="estimate these episodes, A to B - 1, or all; one after the other, J is carried on from each to the next, "
        "unless --jobs or --address runs them side by side",
    )
    parser.add_argument(
        "--start",
        type=Path,
        metavar="NPZ",
        help="go on from this saved J, or begin with a body that 'dense-vs body' learned, brought up to what has "
        "changed since; images go on correcting it",
    )
    parser.add_argument(
        "--time-offset",
        default="auto",
        metavar="S",
        help="seconds to add to the log's times to bring them onto the camera's clock, or auto: find them from the "
        "motion (default: auto)",
    )
    parser.add_argument(
        "--scale", type=float, default=1.0, metavar="X", help="factor on the image size; DIJE halves it (default: 1)"
    )
    parser.add_argument(
        "--every", type=int, default=150, metavar="FRAMES", help="save J every so many frames (default: 150)"
    )
    parser.add_argument(
        "--flow",
        default="dis-medium",
        metavar="METHOD",
        help="optical flow: lucas-kanade, dis, dis-medium, learned, farneback and others (default: dis-medium)",
    )
    parser.add_argument(
        "--smoothing",
        type=float,
        default=JOINT_SMOOTHING,
        metavar="S",
        help="smooth the joints over time by a Gaussian of so many seconds where repeated images show that stamps are "
        f"late; 0 takes them as logged (default: {JOINT_SMOOTHING})",
    )
    parser.add_argument(
        "--covariance",
        default="shared",
        metavar="FORM",
        help="of the filter: shared, diagonal as in DIJE, fixed or full (default: shared)",
    )
    parser.add_argument(
        "--prediction",
        metavar="FORM",
        help="how J follows the moving image: model, DIJE (14), flow, DIJE (13), nearest of the two, or none "
        "(default: nearest; model unless the covariance is shared)",
    )
    parser.add_argument(
        "--sway", action="store_true", help="the camera may sway, as on a humanoid's head: take its motion out of J"
    )
    parser.add_argument("--no-video", action="store_true", help="do not draw the visualization video")
    parser.add_argument(
        "--rerun", action="store_true", help="write estimate.rrd too: images, labels, J and curves for the Rerun viewer"
    )
    parser.add_argument(
        "--truth", type=Path, metavar="NPZ", help="true Jacobians that 'dense-vs record' wrote; prints the error"
    )
    add_device_arguments(parser)
    add_cluster_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    if arguments.every < 1:
        raise DenseVSError(f"--every is {arguments.every}; expected a whole number of at least 1")
    offset = _time_offset(arguments.time_offset)
    recording = open_chosen(arguments)
    numbers = episode_numbers(arguments.episodes, recording.episodes) if arguments.episodes else None
    if numbers is not None and arguments.episode is not None:
        raise DenseVSError("--episode and --episodes are both given; expected one of them")
    if check_whole("--jobs", arguments.jobs, least=1) > 1 or arguments.address is not None:
        if numbers is None:
            raise DenseVSError("--jobs and --address run episodes side by side; expected --episodes A:B or all as well")
        estimate_episodes(arguments, numbers)
        return
    truth = TruthFile.read(arguments.truth, recording.joint_names) if arguments.truth else None
    estimator, body = _start(arguments)
    out = output_folder(arguments.out)
    if numbers is None:
        summary, estimator = _episode(arguments, recording, None, out, offset, estimator, body, truth)
        print(_lines(summary))
        print(f"results in {out}")
        return
    summaries = []
    for number in numbers:
        folder = output_folder(out / f"episode_{number:06d}")
        summary, estimator = _episode(arguments, recording, number, folder, offset, estimator, body, truth)
        summaries.append(summary)
    print(episodes_table(summaries))
    write_json(out / "summary.json", {"episodes": summaries, "versions": versions()})
    if estimator is not None:
        estimator.save(out / "jacobian.npz")
    print(f"results in {out}")


def _start(arguments: argparse.Namespace) -> tuple[DenseJacobian | None, BodyModel | PostureMemory | None]:
    """The saved J or the body that ``--start`` names, whichever it is."""
    if arguments.start is None:
        return None, None
    found = stored_format(arguments.start, "a saved J or body")
    if found == JACOBIAN:
        return DenseJacobian.load(arguments.start, device=arguments.device, threads=arguments.threads), None
    if found in (CHAIN, MEMORY):
        return None, load_body(arguments.start)
    raise DenseVSError(
        f"--start is {arguments.start}, {found or 'a file of unknown kind'}; expected a J that 'dense-vs estimate' "
        "saved, or a body that 'dense-vs body' learned"
    )


def _episode(
    arguments: argparse.Namespace,
    recording: Recording,
    number: int | None,
    out: Path,
    offset: float | None,
    start: DenseJacobian | None,
    body: BodyModel | PostureMemory | None,
    truth: TruthFile | None,
) -> tuple[dict[str, Any], DenseJacobian]:
    """Estimate one episode and write its results; its summary and the estimator after it."""
    episode = recording.episode(number)
    images = episode.images()
    size = scaled_size((images.height, images.width), check_number("--scale", arguments.scale, above=0, most=1))
    prior = None if body is None else BodyPrior.of(body, size, len(recording.joint_names))
    done = RecordedEstimate(
        episode if offset is None else episode.shifted(offset),
        scale=arguments.scale,
        method=arguments.flow,
        smoothing=arguments.smoothing,
        device=arguments.device,
        threads=arguments.threads,
        start=start,
        prior=prior,
        label=arguments.rerun,
        sway=arguments.sway,
        **({} if start else {"covariance": arguments.covariance, "prediction": arguments.prediction}),
    )
    if offset is None:
        with progress(f"clock, episode {episode.number}", done.frame_count) as bar:
            clock = survey_episode(episode, on_image=bar.update).offset
        done.align(clock)
    else:
        clock = ClockOffset(offset, 1.0, 0.0, best=offset)
    changed = None
    if isinstance(body, BodyModel):
        change = find_recorded_change(body, done.episode)
        changed = change.describe(recording.joint_names)
        done.begin_with(BodyPrior.of(body.changed(change), size, len(recording.joint_names)))
    started = time.perf_counter()
    drawing = nullcontext() if arguments.no_video else VideoWriter(out / "estimate.mp4", done.fps)
    logging = RerunFile(out / "estimate.rrd", done) if arguments.rerun else nullcontext()
    errors: list[dict[str, Any]] = []
    with drawing as video, logging as rerun, progress(f"estimate, episode {episode.number}", done.frame_count) as bar:
        seen = 0
        for used, (frame, estimator) in enumerate(done, start=1):
            bar.update(done.images - seen)
            seen = done.images
            if rerun is not None:
                rerun.add(frame, estimator)
            if frame.flow is not None:
                if used % arguments.every == 0:
                    estimator.save(out / f"jacobian_{used:06d}.npz")
                errors += _error(truth, frame, estimator, arguments.scale)
                if video is not None:
                    video.write(_picture(frame, estimator, recording.joint_names))
    done.estimator.save(out / "jacobian.npz")
    motions = joint_motions(episode.log)
    together = moved_together(episode.log, [joint.name for joint in motions if joint.moves])
    summary = _summary(done, clock, motions, together, errors, time.perf_counter() - started)
    summary["body_change"] = changed
    summary["advice"] = advice(summary)
    write_json(out / "summary.json", summary)
    write_report(out / "report.png", summary, done)
    if truth is not None:
        _print_errors(arguments.truth, truth, errors)
    return summary, done.estimator


def _summary(
    done: Any, clock: Any, motions: Any, together: Any, errors: list[dict[str, Any]], seconds: float
) -> dict[str, Any]:
    estimator, names = done.estimator, done.episode.log.names
    return {
        "recording": str(done.episode.source.path),
        "format": done.episode.source.name,
        "episode": done.episode.number,
        "camera": done.episode.camera,
        "frames": done.images,
        "skipped_frames": done.episode.skipped_frames,
        "repeated_images": done.repeated,
        "gaps": done.gaps,
        "joints": list(names),
        "size": [estimator.options.height, estimator.options.width],
        "explained_motion": done.explained.settled(),
        "explained_motion_by_quarter": done.explained.quarters(),
        "explained_motion_by_joint": dict(zip(names, done.explained.by_joint(), strict=True)),
        "time_offset_s": clock.seconds,
        "time_offset_confidence": clock.confidence,
        "time_offset_error_s": clock.error,
        "time_offset_drift": clock.drift,
        "time_offset_reason": clock.reason,
        "camera_sway": _sway(done),
        "excitation_by_joint": {joint.name: joint.excitation for joint in motions},
        "unmoved_joints": [joint.name for joint in motions if not joint.moves],
        "joints_moved_together": [list(group) for group in together],
        "share_of_pixels_known": share_of_pixels_known(estimator, done.usual_step),
        "jacobian_error_median": errors[-1]["median"] if errors else None,
        "jacobian_errors": errors,
        "seconds": seconds,
        "fps": done.images / seconds,
        "device": str(estimator.device),
        "versions": versions(),
    }


def _sway(done: RecordedEstimate) -> dict[str, Any] | None:
    """What was found of the camera's own motion."""
    found = done.camera_sway
    if found is None:
        return None
    return {
        "traveled_px": [float(way) for way in found.traveled],
        "share_foretold_by_joints": found.foretold,
        "motions_taken_out": found.taken,
        "motions_unknown": found.unknown,
    }


def _lines(summary: dict[str, Any]) -> str:
    """The table of one episode and what to do about it."""
    offset = f"{summary['time_offset_s']:+.3f} s (confidence {summary['time_offset_confidence']:.2f})"
    rows = [
        ["explained motion after the first quarter", f"{summary['explained_motion']:.3f}"],
        ["by quarter", " ".join(f"{e:.2f}" for e in summary["explained_motion_by_quarter"])],
        ["images", str(summary["frames"])],
        ["images outside the joint log", str(summary["skipped_frames"])],
        ["repeated images", str(summary["repeated_images"])],
        ["gaps", str(summary["gaps"])],
        ["time offset", offset],
        ["share of pixels known", f"{summary['share_of_pixels_known']:.2f}"],
        ["images a second", f"{summary['fps']:.0f}"],
    ]
    if (sway := summary["camera_sway"]) is not None:
        x, y = sway["traveled_px"]
        rows.append(["camera sway, of the image's middle [px]", f"{x:+.1f} {y:+.1f}"])
    joints = [
        [name, f"{summary['excitation_by_joint'][name]:.0f}", f"{summary['explained_motion_by_joint'][name]:.3f}"]
        for name in summary["joints"]
    ]
    parts = [table(["quality", "value"], rows), table(["joint", "excitation", "part of E"], joints)]
    parts += [f"- {summary['body_change']}"] if summary["body_change"] is not None else []
    parts += [f"{summary['frames']} frames in {summary['seconds']:.1f} s"]
    return "\n".join([*parts, *(f"- {line}" for line in summary["advice"])])


def _time_offset(text: str) -> float | None:
    """Seconds, or None for ``auto``."""
    if text == "auto":
        return None
    try:
        return float(text)
    except ValueError:
        raise DenseVSError(f"--time-offset is {text!r}; expected auto or seconds") from None


def _error(truth: TruthFile | None, frame: Any, estimator: DenseJacobian, scale: float) -> list[dict[str, Any]]:
    if truth is None or (true := truth.at(frame.time, scale)) is None:
        return []
    return [{"time": frame.time, **vars(jacobian_error(estimator.to_numpy(), *true))}]


def _print_errors(path: Path, truth: TruthFile, errors: list[dict[str, Any]]) -> None:
    if not errors:
        raise DenseVSError(
            f"{path} has no truth within the estimated frames; it covers {truth.times[0]:.3f} to "
            f"{truth.times[-1]:.3f} s"
        )
    rows = [[f"{e['time']:.2f}", f"{e['median']:.3f}", f"{e['p90']:.3f}", f"{e['inner_median']:.3f}"] for e in errors]
    print(table(["time [s]", "J error median", "90 %", "median 3 px inside"], rows))


def _picture(frame: Any, estimator: DenseJacobian, names: tuple[str, ...]) -> Any:
    view = JacobianView(names)
    panels = [label(as_rgb(frame.image), f"camera {frame.time:.2f} s"), view.flow(frame.flow, "flow u")]
    panels += [view.flow(estimator.predicted_flow(frame.dq), "predicted flow J dq")]
    return tile([*panels, *view.columns(estimator.to_numpy())], columns=3)
