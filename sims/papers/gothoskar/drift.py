"""Online learning: small changes of the held part or of a lens, followed by gradients of a buffer of observations.

The paper describes this in words ("Online Learning and Change-Point Detection") and gives no numbers. Over --samples
observations the features slip by --slip in the hand, or the lens of one camera changes by --warm of its focal lengths
and center, evenly. After every observation the part is moved a step down the gradient of the buffer's loss where that
is larger than noise makes it. Errors are those of the setup at the end, on samples that were not learned from, with and
without following. Steps that the same number of observations of the unchanged setup cause are counted too, and drifts
so fast that the camera is named as one that was moved: it is not followed any further.
"""

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.checks import check_number, check_whole
from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines
from dense_vs.sims.papers.gothoskar.scores import held_out_error
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.observed_arm import ObservedArm

DRIFTS = ("structure", "camera:1")
LEARNED_FROM = 50
BUFFER = 20
SCORED = 10  # times over the drift that errors are taken


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument(
        "--samples", type=int, default=100, metavar="N", help="observations while it drifts (default: 100)"
    )
    parser.add_argument(
        "--slip", type=float, default=0.005, metavar="M", help="of the features in the hand [m] (default: 0.005)"
    )
    parser.add_argument(
        "--warm", type=float, default=0.01, metavar="SHARE", help="change of the lens, a share (default: 0.01)"
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel

    check_whole("--cameras", arguments.cameras, least=2)
    check_whole("--samples", arguments.samples, least=SCORED)
    sizes = {
        "structure": check_number("--slip", arguments.slip, least=0.0, most=0.1),
        "camera:1": check_number("--warm", arguments.warm, least=0.0, most=0.2),
    }
    runs, rows = trials(arguments), []
    with progress("drifts", len(runs) * len(DRIFTS), "drift") as bar:
        for number, what in enumerate(DRIFTS):
            errors = np.zeros((len(runs), 2, SCORED + 1))
            idle = moved = lost = 0
            for r, trial in enumerate(runs):
                model = GenerativeModel.fit(trial.evidence(LEARNED_FROM).observations, seed=trial.seed)
                rng = trial.rng(80 + number)
                idle += follow(trial, model, what, 0.0, arguments.samples, rng)[1]
                errors[r], steps, named = follow(trial, model, what, sizes[what], arguments.samples, rng)
                moved, lost = moved + steps, lost + named
                bar.update()
            rows += _rows(what, sizes[what], errors, (moved, idle, lost), arguments)
            draw_lines(
                arguments.out / f"drift_{what.partition(':')[0]}.png",
                {
                    name: (np.linspace(0, arguments.samples, SCORED + 1), errors[:, place])
                    for place, name in enumerate(("kept", "followed"))
                },
                title=f"A slow drift of {what}, followed by gradients (online learning)",
                x_label="observations",
                y_label="error on held-out samples [px]",
            )
    return rows


def follow(
    trial: Trial, model: "GenerativeModel", what: str, size: float, samples: int, rng: np.random.Generator
) -> tuple[np.ndarray, int, bool]:
    """Errors (2, SCORED + 1) [px] of the model as it was and of one that follows, its steps, and whether it gave up."""
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.evidence import draw_joints, observe

    arm = trial.observed_arm()
    way = rng.normal(size=4)
    tests = draw_joints(arm, TEST_SAMPLES, rng, trial.postures)
    again = GenerativeModel(
        model.parameters.copy(), model.postures, replace(model.report), image_sizes=model.image_sizes
    )
    online, steps, errors = again.online(capacity=BUFFER), 0, []
    for number in range(samples + 1):
        drifted = drifted_arm(arm, what, size * number / samples, way)
        if number:
            seen = observe(drifted, draw_joints(drifted, 1, rng, trial.postures), rng).observations
            online.add(seen.joints[0], seen.pixels[0])
            before = again.parameters
            if not online.ignored:
                online.follow(what)
            steps += again.parameters is not before
        if number * SCORED % samples < SCORED:
            held_out = observe(drifted, tests, rng).observations
            errors.append([held_out_error(model, held_out), held_out_error(again, held_out)])
    return np.array(errors).T, steps, bool(online.ignored)


def drifted_arm(arm: "ObservedArm", what: str, size: float, way: np.ndarray) -> "ObservedArm":
    """The arm after a drift: features shifted by ``size`` [m], or a lens changed by that share.

    Args:
        arm: before.
        what: a name of ``DRIFTS``.
        size: of the change.
        way: four random numbers, its direction.
    """
    if what == "structure":
        return replace(arm, features=arm.features + size * way[:3] / np.linalg.norm(way[:3]))
    camera = arm.cameras[1]
    warm = replace(camera, intrinsics=camera.intrinsics * (1 + size * np.sign(way)))
    return replace(arm, cameras=(arm.cameras[0], warm, *arm.cameras[2:]))


def _rows(
    what: str, size: float, errors: np.ndarray, counts: tuple[int, int, int], arguments: argparse.Namespace
) -> list[Row]:
    seeds, count = tuple(arguments.seeds), len(errors) * arguments.samples
    moved, idle, lost = counts
    unit = "m" if what == "structure" else "of its lens"
    start = f"{what} drifts by {size:g} {unit}:"
    return [
        Row(f"{start} error before, mean", None, float(np.mean(errors[:, 1, 0])), "px", seeds),
        Row(f"{start} error at the end, kept, mean", None, float(np.mean(errors[:, 0, -1])), "px", seeds),
        Row(f"{start} error at the end, followed, mean", None, float(np.mean(errors[:, 1, -1])), "px", seeds),
        Row(f"{start} error at the end, followed, worst", None, float(np.max(errors[:, 1, -1])), "px", seeds),
        Row(f"{start} worst error on the way, followed", None, float(np.max(errors[:, 1])), "px", seeds),
        Row(f"{start} steps in {count} observations", None, float(moved), "", seeds),
        Row(f"{start} of {len(errors)} drifts, taken for a moved camera", None, float(lost), "", seeds),
        Row(f"{what}: steps in {count} observations without a drift", None, float(idle), "", seeds),
    ]
