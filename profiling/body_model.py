"""The body model on simulated arms: learned from a babbling video, asked about postures that it has not seen.

    dense-vs arms panda ur5e baxter fetch
    python profiling/body_model.py [--arms arm,panda] [--cameras A,B] [--images clean,realistic] [--seconds 20]
                                   [--seeds 0,1] [--jobs N] [--json FILE]

The model sees the images and joint readings of the babbling, nothing else. It is then asked about postures drawn from
the box of joint positions that the babbling has covered. Pixels of the robot that the model takes for the background
count in two ways: as infinitely far off, and as what it says of the background, that it stays where it is. In J they
count with a relative error of 1, as J is 0 there. Realistic images come late to their joint readings; the delay is
found as ``dense-vs body`` finds it. The truth is that of the image as its lens shows it.
"""

import argparse
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from asked_bodies import IMAGES, asked_bodies, several
from body_scores import HEADER, BodyScore, metrics_of, rows_of
from metrics import add_report_arguments, report
from postures import go_to, rest
from shared_devices import device_of
from stopped_run import stopped_run
from true_tracks import follows, true_places

from dense_vs.body_model import BodyFitOptions, BodyModel, PointTrackOptions, follow_points
from dense_vs.body_model.fit import fit_body
from dense_vs.body_model.held_out import ONE_DEVIATION
from dense_vs.body_model.refit import refit
from dense_vs.body_model.surface import SurfaceOptions, keyframe_indices
from dense_vs.errors import DenseVSError
from dense_vs.files import write_json
from dense_vs.flow import FlowEstimator, to_gray
from dense_vs.jacobian.error import jacobian_error
from dense_vs.recording.clock_offset import MotionSamples, find_clock_offset
from dense_vs.recording.joint_log import JointLog
from dense_vs.robot import Babbling
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.built_scenes import ARM_NAMES, TUNED_ARMS
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.surface_points import SurfacePoint
from dense_vs.view.provenance import provenance
from dense_vs.view.tables import table

POSTURES = 8  # unseen ones
POINTS = 200  # of the surface, a posture
ANCHORS, SAME_PIXEL = 400, 0.3  # surface points of a keyframe, and px between one and the model's
REFERENCE_FRAMES = PointTrackOptions().stride * PointTrackOptions().reference_every


@dataclass(frozen=True)
class Learned:
    """A babbling: what the model is given; the true links at the frames in which tracks begin; surface points of the
    robot at the frames in which the model finds its surface, by their pixels; the joint steps between all frames."""

    images: list[np.ndarray]
    joints: np.ndarray
    links: dict[int, np.ndarray]
    anchors: dict[int, tuple[np.ndarray, list[SurfacePoint]]]
    commands: np.ndarray


def measure(asked: BodyScore, options: argparse.Namespace) -> BodyScore:
    """Babble, learn, ask."""
    world = make_world(asked, options)
    seen = babble(world, asked.seed, options.seconds)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        tracks = follow_points(seen.images, seen.joints)
        found = fit_body(tracks)
        stride = PointTrackOptions().stride
        images = seen.images[::stride]
        anew = refit(found, tracks, images, BodyFitOptions().focal_prior(tracks.size[1]))
        model = BodyModel.from_fit(anew, images, seen.joints[::stride])
    except DenseVSError as error:
        return replace(asked, failure=str(error))
    fit_seconds, fit_cpu = time.perf_counter() - wall, time.process_time() - cpu
    truth = link_truth(seen, tracks)
    known = (found.all_links != -2) & (truth != -2) & ((truth >= 0) | (found.all_links >= 0))
    on_cpu = argparse.Namespace(**{**vars(options), "device": "cpu"})  # where one robot moves fastest
    of_points = known & follows(tracks, true_places(lambda: make_world(asked, on_cpu), seen.commands, tracks, stride))
    right = found.all_links == truth
    return replace(
        asked,
        **ask(world, model, seen, asked.seed),
        link_share=share_of(right, known),
        tracks=int(known.sum()),
        point_link_share=share_of(right, of_points),
        point_tracks=int(of_points.sum()),
        fit_seconds=fit_seconds,
        fit_cpu_seconds=fit_cpu,
        predict_ms=prediction_time(model, seen.joints),
    )


def babble(world: SimWorld, seed: int, seconds: float) -> Learned:
    """Images and joints of a babbling that is paced by the estimated flow, as a live robot's."""
    babbling = Babbling(len(world.joint_names), seed=seed)
    flow = FlowEstimator(height=world.shape[1], width=world.shape[2], device="cpu")
    low, high = world.joint_limits.T
    images, joints, links, last = [to_gray(world.frame().rgb)], [world.joints()[0]], {0: true_links(world)}, None
    commands = []
    frames, stride = round(seconds * 30), PointTrackOptions().stride
    surfaces = stride * keyframe_indices(len(range(0, frames, stride)), SurfaceOptions().keyframes)
    anchors = {}
    for frame in range(1, frames):
        q = world.joints()[0]
        commands.append(np.clip(q + babbling.step(last), low, high) - q)
        world.step(commands[-1])
        images.append(to_gray(world.frame().rgb))
        joints.append(world.joints()[0])
        last = flow(images[-2], images[-1])
        if frame % REFERENCE_FRAMES == 0:
            links[frame] = true_links(world)
        if frame in surfaces:
            anchors[frame] = some_points(world, seed)
    return Learned(images, on_the_camera_clock(images, np.array(joints)), links, anchors, np.array(commands))


def on_the_camera_clock(images: list[np.ndarray], joints: np.ndarray) -> np.ndarray:
    """Joint positions ``(K, N)`` at the images, whose readings may come late: the delay is found by the motion."""
    samples = MotionSamples()
    times = FRAME_SECONDS * np.arange(len(images))
    for image, stamp in zip(images, times, strict=True):
        samples.add(image, stamp)
    log = JointLog(tuple(f"joint {n}" for n in range(joints.shape[1])), times, joints)
    shifted = find_clock_offset(samples, log).applied(log)
    return shifted.at(np.clip(times, shifted.times[0], shifted.times[-1]))


def some_points(world: SimWorld, seed: int) -> tuple[np.ndarray, list[SurfacePoint]]:
    """Pixels ``(K, 2)`` of what the joints move, and the surface points there."""
    y, x = np.nonzero(world.robot_mask() & (np.linalg.norm(world.true_jacobian(), axis=(2, 3)) > 0))
    chosen = np.random.default_rng([seed, 22]).choice(len(x), min(ANCHORS, len(x)), replace=False)
    pixels = np.column_stack([x, y])[chosen].astype(float)
    return pixels, [world.track_point(pixel) for pixel in pixels]


def true_links(world: SimWorld) -> np.ndarray:
    """Link of every pixel (H, W): the last joint whose column of the true J is not zero, -1 for none."""
    moved = np.abs(world.true_jacobian()).max(axis=2) > 1e-4
    last = moved.shape[-1] - 1 - moved[..., ::-1].argmax(axis=-1)
    return np.where(moved.any(axis=-1) & world.robot_mask(), last, -1)


def link_truth(seen: Learned, tracks) -> np.ndarray:
    """True link of each track at the pixel where it began; -2 within 2 px of another link."""
    truth = np.full(tracks.pixels.shape[1], -2)
    for m, reference in enumerate(tracks.references):
        links = seen.links[int(reference) * PointTrackOptions().stride]
        x, y = np.rint(tracks.pixels[reference, m]).astype(int)
        around = links[max(0, y - 2) : y + 3, max(0, x - 2) : x + 3]
        if (around == around[0, 0]).all():
            truth[m] = around[0, 0]
    return truth


def share_of(right: np.ndarray, counted: np.ndarray) -> float:
    """Share of those that count; NaN where none does."""
    return float(np.mean(right[counted])) if counted.any() else float("nan")


def ask(world: SimWorld, model: BodyModel, seen: Learned, seed: int) -> dict[str, float]:
    """Errors of points [px], J, labels, depth and the model's knowledge of its errors at unseen postures."""
    joints = seen.joints
    rng = np.random.default_rng([seed, 21])
    low, high = joints.min(axis=0), joints.max(axis=0)
    rest(world)
    q_seen = world.joints()[0]
    mask = world.robot_mask() & (np.linalg.norm(world.true_jacobian(), axis=(2, 3)) > 0)
    y, x = np.nonzero(mask)
    chosen = rng.choice(len(x), min(POINTS, len(x)), replace=False)
    pixels = np.column_stack([x, y])[chosen].astype(float)
    surface = [world.track_point(pixel) for pixel in pixels]
    distances, stays, errors, overlaps, ratios, within = [], [], [], [], [], []
    anchored, anchors = anchored_points(model, seen)
    for _ in range(POSTURES):
        go_to(world, rng.uniform(low, high))
        rest(world)
        q = world.joints()[0]
        true = np.array([world.project(point) for point in surface])
        off = np.linalg.norm(model.trace(pixels, q_seen, q) - true, axis=1)
        distances.append(np.where(np.isfinite(off), off, np.inf))
        stays.append(np.where(np.isfinite(off), off, np.linalg.norm(pixels - true, axis=1)))
        J, robot = world.true_jacobian(), world.robot_mask()
        errors.append(jacobian_error(model.jacobian(q), J, robot))
        there = model.image(q)
        overlaps.append((there.body & robot).sum() / max(1, (there.body | robot).sum()))
        both = there.body & robot
        ratios.append(there.depths[both] / world.frame().depth[both])
        points = model.points(q)
        off = points.pixels[anchored] - np.array([world.project(point) for point in anchors]).reshape(-1, 2)
        inverse = np.linalg.inv(points.covariances[anchored])
        within.append(np.einsum("pi,pij,pj->p", off, inverse, off) < ONE_DEVIATION)
    off, ratio = np.concatenate(distances), np.concatenate(ratios)
    known = off[np.isfinite(off)]
    return {
        "points_median": float(np.quantile(off, 0.5, method="higher")),
        "points_p90": float(np.quantile(off, 0.9, method="higher")),
        "stays_p90": float(np.quantile(np.concatenate(stays), 0.9, method="higher")),
        "known_p90": float(np.quantile(known, 0.9, method="higher")) if len(known) else float("inf"),
        "known_share": len(known) / len(off),
        "jacobian_median": float(np.mean([e.median for e in errors])),
        "jacobian_p90": float(np.mean([e.p90 for e in errors])),
        "overlap": float(np.mean(overlaps)),
        "depth": float(np.median(np.abs(ratio / np.median(ratio) - 1))),
        "within": float(np.mean(np.concatenate(within))) if anchors else float("nan"),
    }


def anchored_points(model: BodyModel, seen: Learned) -> tuple[np.ndarray, list[SurfacePoint]]:
    """Points of the model's surface, by index, that were found at pixels whose true surface points are known."""
    indices, points = [], []
    precision = model.precision
    if precision is None:
        return np.zeros(0, int), points
    for frame, (pixels, surface) in seen.anchors.items():
        keyframe = np.abs(precision.postures - seen.joints[frame]).max(axis=1).argmin()
        own = np.flatnonzero(precision.keyframes == keyframe)
        places = model.points(seen.joints[frame]).pixels[own]
        for pixel, point in zip(pixels, surface, strict=True):
            apart = np.linalg.norm(places - pixel, axis=1)
            if len(own) and apart.min() < SAME_PIXEL:
                indices.append(own[apart.argmin()])
                points.append(point)
    return np.array(indices, int), points


def prediction_time(model: BodyModel, joints: np.ndarray) -> float:
    """Least time of a J of the whole image [ms]."""
    times = []
    for q in joints[:: max(1, len(joints) // 10)]:
        start = time.perf_counter()
        model.jacobian(q)
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def make_world(asked: BodyScore, options: argparse.Namespace, **more: Any) -> SimWorld:
    """The arm's world with its first joints; ours have one camera and all of theirs. ``more`` is for the world."""
    device = device_of(asked.name, options.device)
    common = {
        "seed": asked.seed, "device": device, "realism": False if asked.images == "clean" else asked.images,
        **more,
    }  # fmt: skip
    if asked.arm not in ARM_NAMES:
        return SimWorld(asked.arm, **common)
    names = SimWorld(asked.arm, camera=asked.camera, device=device, height=8, width=8).joint_names
    return SimWorld(asked.arm, joints=names[: options.joints], camera=asked.camera, **common)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--arms", default=",".join(["arm", *TUNED_ARMS]), help="by comma (default: our own and the four of the table)"
    )
    parser.add_argument("--cameras", default="A,B", help="of the commercial arms, by comma (default: A,B)")
    parser.add_argument("--images", default="clean", help=f"some of {', '.join(IMAGES)}, by comma (default: clean)")
    parser.add_argument("--joints", type=int, default=4, help="of the commercial arms, from the base (default: 4)")
    parser.add_argument("--seconds", type=float, default=20.0, help="of babbling (default: 20)")
    parser.add_argument("--seeds", default="0", help="of motion and postures, by comma (default: 0)")
    parser.add_argument("--jobs", type=int, default=1, help="bodies at a time, a core each where above 1 (default: 1)")
    parser.add_argument(
        "--device", default="auto", help="of the robots: auto, cpu, cuda:N, or some of these by comma (default: auto)"
    )
    parser.add_argument("--resume", action="store_true", help="go on with a run that was stopped, as --json has it")
    add_report_arguments(parser)
    options = parser.parse_args()
    asked = asked_bodies(parser, options)
    wp.config.log_level = wp.LOG_ERROR
    origin = provenance(options, leave_out=("json", "gate"))
    before, began = stopped_run(options.json, origin) if options.resume else ([], {})
    found = {score.name: score for score in map(BodyScore.of_row, before)}
    runs = [(one, options) for one in asked if one.name not in found]
    for score in several(run, runs, options.jobs):
        found[score.name] = score
        print(f"{score.name}: {score.failure}" if score.failure else table(HEADER, rows_of([score])), flush=True)
        if options.json is not None:  # a run that is stopped has not run for nothing
            write_json(options.json, {**origin, **began, **content([*found.values()], len(asked))})
    scores = [found[one.name] for one in asked]
    print(table(HEADER, rows_of(scores)))
    return report(metrics_of(scores), options, **began, **content(scores, len(asked)))


def content(scores: list[BodyScore], asked: int) -> dict[str, Any]:
    """What the file holds beside its origin and the metrics: the bodies so far, and whether that is all of them."""
    return {"finished": len(scores) == asked, "rows": [asdict(score) for score in scores]}


def run(task: tuple[BodyScore, argparse.Namespace]) -> BodyScore:
    """Measure one body."""
    return measure(*task)


if __name__ == "__main__":
    raise SystemExit(main())
