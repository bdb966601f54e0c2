"""``dense-vs body``: learn a body model from a recording: links, lines of the joints, camera and surface.

The camera stands still and the joints babble or reach; no markers, no calibration. How well the body predicts images
that it has not seen is measured by learning it first from the beginning of the recording alone. A picture of the links
and joints lies beside the model.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from dense_vs.body_model import BodyModel, FitOptions, TrackOptions, follow_points
from dense_vs.body_model.fit import fit_body
from dense_vs.body_model.held_out import held_out_error
from dense_vs.cli.recording_options import add_recording_arguments, open_chosen
from dense_vs.errors import DenseVSError
from dense_vs.pipeline.recorded import JOINT_SMOOTHING
from dense_vs.recording import Episode, survey_episode
from dense_vs.recording.distinct_images import DistinctImages
from dense_vs.view.body_picture import body_picture, write_picture
from dense_vs.view.progress import progress
from dense_vs.view.tables import table

POOR = 0.55  # px, median distance between tracks and model above which fits of simulated arms were wrong


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_recording_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="NPZ", help="file for the model")
    parser.add_argument(
        "--focal-length",
        type=float,
        metavar="PX",
        help="of the camera; estimated from the image's width on if not given",
    )
    parser.add_argument(
        "--held-out",
        type=float,
        default=0.2,
        metavar="SHARE",
        help="share of the images, the last ones, to measure the prediction on; 0 measures nothing (default: 0.2)",
    )
    parser.add_argument(
        "--time-offset",
        default="auto",
        metavar="S",
        help="seconds to add to the log's times, or auto: find them from the motion (default: auto)",
    )
    parser.add_argument("--picture", type=Path, metavar="PNG", help="picture of the links (default: beside the model)")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    if not 0 <= arguments.held_out < 1:
        raise DenseVSError(f"--held-out is {arguments.held_out}; expected a share from 0 to below 1")
    options = FitOptions(focal_length=arguments.focal_length)
    recording = open_chosen(arguments)
    episode = recording.episode()
    count = episode.images().frame_count
    if arguments.time_offset == "auto":
        with progress("clock", count) as bar:
            episode = episode.shifted(survey_episode(episode, on_image=bar.update).offset)
    else:
        try:
            episode = episode.shifted(float(arguments.time_offset))
        except ValueError:
            raise DenseVSError(f"--time-offset is {arguments.time_offset!r}; expected auto or seconds") from None
    images, joints, picture = read_images(episode)
    started = time.perf_counter()
    tracks = follow_points(images, joints)
    held_out = held_out_error(tracks, arguments.held_out, options) if arguments.held_out else None
    stride = TrackOptions().stride
    model = BodyModel.from_fit(fit_body(tracks, options), images[::stride], joints[::stride])
    seconds = time.perf_counter() - started
    model.save(arguments.out)
    path = arguments.picture or arguments.out.with_suffix(".png")
    write_picture(path, body_picture(model, picture, joints[-1], recording.joint_names))
    rows = [
        ["images", str(len(images))],
        ["points followed", str(tracks.pixels.shape[1])],
        ["median distance of tracks from the model [px]", f"{model.error:.2f}"],
        ["focal length [px]", f"{model.focal_length:.0f}"],
        ["points of the surface", str(len(model.surface.links))],
    ]
    if held_out is not None:
        rows += [
            ["held-out images: median distance, 90 % [px]", f"{held_out.median:.2f}, {held_out.p90:.2f}"],
            ["  had the points stood still", f"{held_out.standing_still:.2f}"],
        ]
    print(table(["quality", "value"], rows))
    print(table(["joint", "carried by", "surface points"], joint_rows(model, recording.joint_names)))
    if model.error > POOR:
        print(f"- tracks are {model.error:.2f} px off the model; above {POOR} px links and axes are not to be trusted")
    print(f"learned in {seconds:.1f} s; model in {arguments.out}, picture in {path}")


def read_images(episode: Episode) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Gray images without repetitions, the joints at their times ``(K, N)``, and the last image in color."""
    stamped = ((frame.image, frame.time) for frame in episode)
    log = episode.log
    smooth = log.smoothed(JOINT_SMOOTHING)
    images, joints, last = [], [], None
    for found in DistinctImages(stamped, episode.images().fps):
        images.append(found.gray)
        used = smooth if found.evened else log
        joints.append(used.at(np.clip([found.time], log.times[0], log.times[-1]))[0])
        last = found.image
    if last is None:
        raise DenseVSError("the recording has no image within its joint log")
    return images, np.array(joints), last


def joint_rows(model: BodyModel, names: tuple[str, ...]) -> list[list[str]]:
    """A row a joint: its name, the joint before it, and how many points its link has."""
    rows = []
    for n, name in enumerate(names):
        parent = model.chain.parents[n]
        carried = "moves too little" if not model.learned[n] else names[parent] if parent >= 0 else "nothing"
        rows.append([name, carried, str(int((model.surface.links == n).sum()))])
    return rows
