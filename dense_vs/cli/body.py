"""``dense-vs body``: learn a body from recordings: links, joints and surface, or J remembered by posture.

The camera stands still and the joints babble or reach; no markers, no calibration. A video or a folder of images is
followed by its joint log. A chain of links is fitted first. Where joints move together, as in reaches, no chain can be
found: then J is remembered by posture, for the steps that the joints made. Which of the two is kept is decided by the
motion that each explains in images held out, the last ones. 'dense-vs estimate --start' begins with either.

With --from nothing is learned anew: a body that was learned before is brought up to what has changed since, a joint's
zero or where the camera is.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dense_vs.body_model import (
    BodyFitOptions,
    BodyModel,
    ChangeKind,
    Keyframes,
    MemoryFit,
    PointTrackOptions,
    PostureMemory,
    find_change,
    follow_points,
)
from dense_vs.body_model.fit import fit_body
from dense_vs.body_model.held_out import (
    ExplainedFlow,
    HeldOutError,
    first_part,
    held_out_error,
    share_within_deviation,
)
from dense_vs.body_model.refit import refit
from dense_vs.body_model.tracks import PointTracks
from dense_vs.checks import check_number
from dense_vs.cli.body_recordings import SeenBody, read_recordings
from dense_vs.errors import DenseVSError
from dense_vs.files import check_writable
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.view.body_picture import body_picture, memory_picture, write_picture
from dense_vs.view.body_rerun import write_body_rerun
from dense_vs.view.progress import progress
from dense_vs.view.rerun_file import require_rerun
from dense_vs.view.tables import table

POOR = 0.55  # px, median distance between tracks and model above which fits of simulated arms were wrong
LEAST_EXPLAINED = 0.5  # share of the motion that a chain has to explain
BETTER = 0.1  # by which a memory has to explain more than a chain, which knows links, depths and hidden points too


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        metavar="RECORDING",
        help="videos, LeRobot folders, ROS bags or folders of images; a video's JOINTS.csv follows it",
    )
    parser.add_argument("--episode", type=int, metavar="N", help="episode of each recording (default: the first)")
    parser.add_argument("--episodes", metavar="A:B", help="learn from these episodes, A to B - 1, or all")
    parser.add_argument("--camera", metavar="NAME", help="camera of the recordings (default: the first)")
    parser.add_argument(
        "--joints", dest="joint_names", metavar="A,B", help="joints to use, patterns as 'kRight*' too (default: all)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="NPZ", help="file for the body")
    parser.add_argument(
        "--from",
        dest="since",
        type=Path,
        metavar="BODY",
        help="find what has changed since this body was learned, a joint's zero or where the camera is, and write the "
        "body as it is now; a few seconds of motion are enough",
    )
    parser.add_argument(
        "--kind",
        choices=("auto", "chain", "posture"),
        default="auto",
        help="links of a chain, J by posture, or the one that explains what was held out (default: auto)",
    )
    parser.add_argument("--scale", type=float, default=1.0, metavar="X", help="factor on the image size (default: 1)")
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
        help="share of the images, the last ones or the last episodes, to measure the prediction on; 0 measures "
        "nothing (default: 0.2)",
    )
    parser.add_argument(
        "--time-offset",
        default="auto",
        metavar="S",
        help="seconds to add to the log's times, or auto: find them from the motion (default: auto)",
    )
    parser.add_argument(
        "--rerun", action="store_true", help="write the body in 3D too, for the Rerun viewer, as .rrd beside the file"
    )
    parser.add_argument("--picture", type=Path, metavar="PNG", help="picture of the body (default: beside the file)")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    _check(arguments)
    before = None if arguments.since is None else BodyModel.load(arguments.since)
    seen = read_recordings(arguments)
    if before is not None:
        _bring_up_to(before, seen, arguments)
        return
    started = time.perf_counter()
    learned = _learn(seen, arguments)
    body = learned.kept(arguments.kind)
    body.save(arguments.out)
    path = _picture_path(arguments)
    if isinstance(body, BodyModel):
        write_picture(path, body_picture(body, seen.last, seen.joints[-1], seen.names))
        if arguments.rerun:
            write_body_rerun(arguments.out.with_suffix(".rrd"), body, seen.images, np.array(seen.joints), seen.names)
    else:
        write_picture(path, memory_picture(body, seen.last, seen.joints[-1]))
    print(table(["quality", "value"], _rows(seen, learned, body)))
    if isinstance(body, BodyModel):
        print(table(["joint", "kind", "carried by", "surface points"], joint_rows(body, seen.names)))
        if doubt := learned.doubt:
            print(f"- {doubt}")
    else:
        print(
            f"- {learned.why_no_chain(arguments.kind)}: J is remembered by posture, for the steps that the joints made"
        )
        print("- it knows no links, no depth and no hidden points; babbling, each joint by itself, would tell them")
        if arguments.rerun:
            print("- there is nothing to show in 3D without them: no .rrd file was written")
    print(f"learned in {time.perf_counter() - started:.1f} s; body in {arguments.out}, picture in {path}")


def _bring_up_to(before: BodyModel, seen: SeenBody, arguments: argparse.Namespace) -> None:
    """Write a body that was learned before as it is in a recording.

    Raises:
        DenseVSError: it does not look as it did, and nothing that is looked for tells why; nothing is written then.
    """
    change = find_change(before, seen.images, np.array(seen.joints))
    if change.kind is ChangeKind.UNKNOWN:
        raise DenseVSError(f"{change.describe(seen.names)}; learn it anew, without --from")
    body = before.changed(change)
    body.save(arguments.out)
    path = _picture_path(arguments)
    write_picture(path, body_picture(body, seen.last, seen.joints[-1], seen.names))
    print(f"{change.describe(seen.names)}; body in {arguments.out}, picture in {path}")


def _picture_path(arguments: argparse.Namespace) -> Path:
    return arguments.picture or arguments.out.with_suffix(".png")


@dataclass
class Learned:
    """Both kinds, as far as they were learned, and what each explains of the motion held out."""

    chain: BodyModel | None
    memory: PostureMemory | None
    tracks: PointTracks | None
    held_out: HeldOutError | None
    by_chain: ExplainedFlow
    by_memory: ExplainedFlow
    reason: str  # why there is no chain
    within: float = float("nan")  # share of the places held out that are within one deviation of the chain's

    def kept(self, kind: str) -> BodyModel | PostureMemory:
        """The kind that is asked for, or the one that explains more.

        Raises:
            DenseVSError: it could not be learned.
        """
        if kind == "chain" or self.memory is None:
            if self.chain is None:
                raise DenseVSError(self.reason)
            return self.chain
        if kind == "posture" or self.chain is None:
            return self.memory
        if np.isnan(self.by_memory.share):
            return self.chain if self.chain.error <= POOR else self.memory
        enough = self.by_chain.share >= max(LEAST_EXPLAINED, self.by_memory.share - BETTER)
        return self.chain if enough else self.memory

    @property
    def doubt(self) -> str:
        """Why the chain is not to be trusted; empty where nothing speaks against it, or nothing was held out."""
        if not self.by_chain.share < LEAST_EXPLAINED:
            return ""
        return (
            f"the chain explains {self.by_chain.share:.2f} of the motion held out; below {LEAST_EXPLAINED} its links "
            "and axes are not to be trusted"
        )

    def why_no_chain(self, kind: str) -> str:
        """Why the memory was kept."""
        if kind == "posture":
            return "asked for by --kind"
        if self.chain is None:
            return f"no chain of joints was found ({self.reason})"
        return "the chain of joints that was found explains too little of the motion"


def _check(arguments: argparse.Namespace) -> None:
    if not 0 <= arguments.held_out < 1:
        raise DenseVSError(f"--held-out is {arguments.held_out}; expected a share from 0 to below 1")
    if arguments.episode is not None and arguments.episodes is not None:
        raise DenseVSError("--episode and --episodes are both given; expected one of them")
    if arguments.focal_length is not None:
        check_number("--focal-length", arguments.focal_length, above=0)
    check_writable(arguments.out)
    if arguments.picture is not None:
        check_writable(arguments.picture)
    if arguments.rerun:
        require_rerun()
        if arguments.since is not None:
            raise DenseVSError("--from and --rerun are both given; expected one of them")


def _learn(seen: SeenBody, arguments: argparse.Namespace) -> Learned:
    """Learn what is asked for: from the first images, judged by the others, then from all."""
    cut = seen.cut(arguments.held_out)
    if not 2 < cut <= len(seen.images):
        raise DenseVSError(f"{len(seen.images)} images, {cut} of them to learn from; expected more, or less held out")
    found = Learned(None, None, None, None, ExplainedFlow(), ExplainedFlow(), "")
    part = None
    if arguments.kind != "posture":
        try:
            part = _learn_chain(seen, cut, BodyFitOptions(focal_length=arguments.focal_length), found)
        except DenseVSError as error:
            found.reason = str(error)
    if arguments.kind != "chain":
        found.memory = _learn_memory(seen, cut, found.by_memory)
    if part is not None:
        flow = FlowEstimator("dis-medium", *seen.images[0].shape)
        for k, step in seen.steps(cut, len(seen.images)):
            found.by_chain.add(flow(seen.images[k - 1], seen.images[k]), part.flow(seen.joints[k], step))
    return found


def _learn_chain(seen: SeenBody, cut: int, options: BodyFitOptions, found: Learned) -> BodyModel | None:
    """Fit a chain to all images; that of the first ones, where some are held out."""
    joints = np.array(seen.joints)
    found.tracks = tracks = follow_points(seen.images, joints)
    stride, count = PointTrackOptions().stride, len(seen.images)
    part = None
    if cut < count:
        share = 1 - cut / count
        first = fit_body(first_part(tracks, share), options)
        found.held_out = held_out_error(tracks, share, options, found=first)
        known, images = first_part(tracks, share), seen.images[:cut:stride]
        anew = refit(first, known, images[: len(known.joints)], options.focal_prior(tracks.size[1]))
        part = BodyModel.from_fit(anew, images, joints[:cut:stride])
        found.within = share_within_deviation(part, tracks, len(first_part(tracks, share).joints))
    found.chain = BodyModel.fit(seen.images, joints, tracks=tracks, fit_options=options)
    return part


def _learn_memory(seen: SeenBody, cut: int, explained: ExplainedFlow) -> PostureMemory:
    """Remember all images; what those before the cut explain of the others is added up."""
    size, count = seen.images[0].shape, len(seen.images)
    moved = list(seen.steps(0, count))
    positions, steps = (np.array(a) for a in ([seen.joints[k] for k, _ in moved], [step for _, step in moved]))
    if not moved:
        raise DenseVSError(f"none of {count} images follows another; expected images without gaps between them")
    flow = FlowEstimator("dis-medium", *size)
    fit = MemoryFit(size, Keyframes.choose(positions, steps, seen.learned))
    part = None
    with progress("motion", len(moved), unit="image") as bar:
        for k, step in moved:
            measured = flow(seen.images[k - 1], seen.images[k])
            if k >= cut:
                part = part or fit.solved()
                explained.add(measured, part.flow(seen.joints[k], step))
            fit.add(measured, seen.joints[k], step)
            bar.update()
    return fit.solved()


def _rows(seen: SeenBody, learned: Learned, body: BodyModel | PostureMemory) -> list[list[str]]:
    rows = [["images", str(len(seen.images))], ["episodes", str(len(seen.starts))]]
    if isinstance(body, BodyModel):
        assert learned.tracks is not None
        rows += [
            ["points followed", str(learned.tracks.pixels.shape[1])],
            ["median distance of its points' places from the model [px]", f"{body.error:.2f}"],
            ["focal length [px]", f"{body.focal_length:.0f}"],
            ["points of the surface", str(len(body.surface.links))],
        ]
        if (held_out := learned.held_out) is not None:
            rows += [
                ["held-out images: median distance, 90 % [px]", f"{held_out.median:.2f}, {held_out.p90:.2f}"],
                ["  had the points stood still", f"{held_out.standing_still:.2f}"],
                ["  within one deviation of the model's (0.68 expected)", f"{learned.within:.2f}"],
            ]
    else:
        rows += [["keyframes", f"{len(body.keyframes.positions)} of rank {body.keyframes.rank}"]]
    for name, explained in (("a chain", learned.by_chain), ("postures", learned.by_memory)):
        if np.isfinite(explained.share):
            rows += [[f"held-out motion explained by {name}", f"{explained.share:.3f}"]]
    return [*rows, ["kept", "a chain of links" if isinstance(body, BodyModel) else "J by posture"]]


def joint_rows(model: BodyModel, names: tuple[str, ...]) -> list[list[str]]:
    """A row a joint: its name, whether it turns or slides, the joint before it, and how many points its link has."""
    rows = []
    for n, name in enumerate(names):
        parent = model.chain.parents[n]
        carried = "moves too little" if not model.learned[n] else names[parent] if parent >= 0 else "nothing"
        kind = "" if not model.learned[n] else "slides" if model.chain.slides[n] else "turns"
        rows.append([name, kind, carried, str(int((model.surface.links == n).sum()))])
    return rows
