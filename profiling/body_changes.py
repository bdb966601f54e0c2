"""What has changed since a body was learned: how often it is named rightly, and how well the body is known after that.

    dense-vs arms panda ur5e baxter fetch
    python profiling/body_changes.py [--arms arm,panda] [--cameras A,B] [--images clean,realistic] [--seconds 10]
                                     [--seeds 0,1] [--jobs N] [--json FILE]

A body is learned from a babbling video. On "another day" the robot babbles for some seconds otherwise, and one thing
has changed: nothing, the zero of one joint's readings, those of all joints, or where the camera is; or the body looks
otherwise, as the mirror image of itself does. J without an image is then asked at postures not seen, over all of the
robot's pixels, before and after the change is taken into account.
"""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
import warp as wp
from asked_bodies import IMAGES, asked_bodies, several
from body_model import babble, make_world
from body_scores import BodyScore
from change_scores import HEADER, Case, ChangeScore, metrics_of, rows_of, summary_rows
from metrics import add_report_arguments, report
from postures import go_to, rest

from dense_vs.body_model import BodyChange, BodyModel, ChangeKind, find_change
from dense_vs.errors import DenseVSError
from dense_vs.files import write_json
from dense_vs.jacobian.error import jacobian_error
from dense_vs.sims import DomainRandomization
from dense_vs.sims.engine.built_scenes import TUNED_ARMS
from dense_vs.view.provenance import provenance
from dense_vs.view.tables import table

DAY = 5.0  # s of babbling on the other day
OTHERWISE = 1000  # added to the seed of that babbling
POSTURES = 4  # at which J is asked for
OFFSETS = 0.02, 0.05, 0.1, 0.2  # rad, of one joint's zero
ALL_OFFSETS = 0.05  # rad, standard deviation of all zeros together
MOVES = (0.02, 0.03), (0.05, 0.08)  # m along each axis, and rad, that a camera is moved by at most
OURS = "arm", "painted"

Truth = list[tuple[np.ndarray, np.ndarray, np.ndarray]]  # postures (N,), J (H, W, 2, N), masks (H, W)


def measure(asked: BodyScore, options: argparse.Namespace) -> list[ChangeScore]:
    """Learn a body, change one thing after the other, and ask what has changed."""
    world = make_world(asked, options)
    seen = babble(world, asked.seed, options.seconds)
    try:
        model = BodyModel.fit(seen.images, seen.joints)
    except DenseVSError as error:
        return [ChangeScore(asked.arm, asked.camera, asked.images, asked.seed, failure=str(error))]
    box = seen.joints.min(axis=0), seen.joints.max(axis=0)
    return [
        judged(asked, case, model, images, joints + case.offsets, truth)
        for case, images, joints, truth in days(asked, options, box)
    ]


def days(
    asked: BodyScore, options: argparse.Namespace, box: tuple[np.ndarray, np.ndarray]
) -> Iterator[tuple[Case, list[np.ndarray], np.ndarray, Truth]]:
    """Every case with its images, the robot's true postures ``(K, N)`` [rad], and the truth at postures not seen."""
    rng = np.random.default_rng([asked.seed, 31])
    images, joints, truth = day(asked, options, box, None)
    count = joints.shape[1]
    none = np.zeros(count)
    yield Case(ChangeKind.NOTHING, none), images, joints, truth
    for n in range(count):
        offset = OFFSETS[(n + asked.seed) % len(OFFSETS)] * rng.choice([-1, 1])
        yield Case(ChangeKind.JOINT, offset * np.eye(count)[n]), images, joints, truth
    yield Case(ChangeKind.JOINTS, rng.normal(0, ALL_OFFSETS, count)), images, joints, truth
    yield Case(ChangeKind.UNKNOWN, none), [np.fliplr(image).copy() for image in images], joints, truth
    for position, angle in MOVES:
        moved = DomainRandomization(camera_position=position, camera_angle=angle)
        yield Case(ChangeKind.CAMERA, none, position, angle), *day(asked, options, box, moved)


def day(
    asked: BodyScore,
    options: argparse.Namespace,
    box: tuple[np.ndarray, np.ndarray],
    moved: DomainRandomization | None,
) -> tuple[list[np.ndarray], np.ndarray, Truth]:
    """Images and joints of another babbling, perhaps before a camera that was moved, and the truth at some postures."""
    world = make_world(asked, options, randomization=moved)
    seen = babble(world, asked.seed + OTHERWISE, DAY)
    rng = np.random.default_rng([asked.seed, 32])
    truth = []
    for _ in range(POSTURES):
        go_to(world, rng.uniform(*box))
        rest(world)
        truth.append((world.joints()[0], world.true_jacobian(), world.robot_mask()))
    return seen.images, seen.joints, truth


def judged(
    asked: BodyScore, case: Case, model: BodyModel, images: list[np.ndarray], readings: np.ndarray, truth: Truth
) -> ChangeScore:
    """What is found of one change, and what the body is worth before and after."""
    change = find_change(model, images, readings)
    return ChangeScore(
        asked.arm,
        asked.camera,
        asked.images,
        asked.seed,
        case.kind,
        change.kind,
        named=case.named(change),
        among=case.among(change),
        offset=float(np.abs(case.offsets).max()),
        offset_error=float(np.abs(change.offsets - case.offsets).max()),
        off=change.off,
        agreement_before=change.agreement_before,
        agreement=change.agreement,
        before=error_of(model, case.offsets, truth),
        after=error_of(model.changed(change), case.offsets, truth),
    )


def error_of(model: BodyModel, offsets: np.ndarray, truth: Truth) -> float:
    """J's median error over the robot's pixels, the mean of the postures; readings are larger by ``offsets`` (N,)."""
    none = np.zeros(3)
    by_postures = model.changed(
        BodyChange(ChangeKind.JOINTS, -offsets, none, none, 0.0, 0.0, 0.0, 0, (), ("rad",) * len(offsets))
    )
    return float(np.mean([jacobian_error(by_postures.jacobian(q), J, robot).median for q, J, robot in truth]))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--arms", default=",".join([*OURS, *TUNED_ARMS]), help="by comma (default: two of ours, four of the table)"
    )
    parser.add_argument("--cameras", default="A,B", help="of the commercial arms, by comma (default: A,B)")
    parser.add_argument(
        "--images", default="clean,realistic", help=f"some of {', '.join(IMAGES)}, by comma (default: clean,realistic)"
    )
    parser.add_argument("--joints", type=int, default=4, help="of the commercial arms, from the base (default: 4)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of babbling that it is learned from (default: 10)")
    parser.add_argument("--seeds", default="0", help="of motion and changes, by comma (default: 0)")
    parser.add_argument("--jobs", type=int, default=1, help="bodies at a time, a core each where above 1 (default: 1)")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N, of the robots (default: auto)")
    add_report_arguments(parser)
    options = parser.parse_args()
    asked = asked_bodies(parser, options)
    wp.config.log_level = wp.LOG_ERROR
    origin = provenance(options, leave_out=("json", "gate"))
    found: dict[str, list[ChangeScore]] = {}
    for scores in several(run, [(one, options) for one in asked], options.jobs):
        found[scores[0].body] = scores
        print(table(HEADER, rows_of(scores)), flush=True)
        if options.json is not None:  # a run that is stopped has not run for nothing
            write_json(options.json, {**origin, **content(found, len(asked))})
    scores = [score for one in asked for score in found[one.name]]
    print(table(HEADER, rows_of(scores)))
    print(table(("changed", "bodies", "named rightly", "or among those named"), summary_rows(scores)))
    return report(metrics_of(scores), options, **content(found, len(asked)))


def content(found: dict[str, list[ChangeScore]], asked: int) -> dict[str, Any]:
    """What the file holds beside its origin and the metrics: the changes so far, and whether that is all of them."""
    rows = [asdict(score) for scores in found.values() for score in scores]
    return {"finished": len(found) == asked, "rows": rows}


def run(task: tuple[BodyScore, argparse.Namespace]) -> list[ChangeScore]:
    """Measure one body."""
    return measure(*task)


if __name__ == "__main__":
    raise SystemExit(main())
