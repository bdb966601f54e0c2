"""Tables 1 and 2: what learning end to end gains, and what is lost without the stages before it.

Table 1: errors of the stages composed, before and after learning end to end; the paper's numbers are its loss, which
with noise of half a pixel is about the mean squared distance, so that is given beside the mean distance. Table 2: all
parameters at once from random values; cameras and structure first, the kinematics from random values; all stages. Ours
are solved by Levenberg-Marquardt from one random start where values are random; --published adds the L-BFGS stages of
the paper, which are slow. All errors are on the training samples, as the paper's.
"""

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_bars
from dense_vs.sims.papers.gothoskar.scores import pixel_error
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.generative import Observations

PAPER_BEFORE, PAPER_AFTER = 414.21, 0.47
PAPER_ALL, PAPER_CAMERA_ALL = 549.4, 27077.9
STARTS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=50, metavar="N", help="training samples (default: 50)")
    parser.add_argument("--published", action="store_true", help="also the L-BFGS stages of the paper")
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel

    runs = trials(arguments)
    orders: dict[str, float] = {
        "before end-to-end": PAPER_BEFORE,
        "after end-to-end": PAPER_AFTER,
        "all at once": PAPER_ALL,
        "cameras and structure, all": PAPER_CAMERA_ALL,
    }
    if arguments.published:
        orders |= {"L-BFGS, before end-to-end": PAPER_BEFORE, "L-BFGS, after end-to-end": PAPER_AFTER}
    squares: dict[str, list[float]] = {order: [] for order in orders}
    distances: list[float] = []
    with progress("fits", len(runs) * (3 + arguments.published), "fit") as bar:
        for trial in runs:
            observations = trial.evidence(arguments.samples).observations
            model = GenerativeModel.fit(observations, seed=trial.seed)
            before, after = _end_to_end(model.report, observations)
            squares["before end-to-end"].append(before)
            squares["after end-to-end"].append(after)
            distances.append(pixel_error(model.pixels(observations.joints), observations.pixels))
            bar.update()
            squares["all at once"].append(_from_random(trial, observations, reconstructed=False))
            bar.update()
            squares["cameras and structure, all"].append(_from_random(trial, observations, reconstructed=True))
            bar.update()
            if arguments.published:
                report = GenerativeModel.fit(observations, kinematics="dh", method="paper", seed=trial.seed).report
                before, after = _end_to_end(report, observations)
                squares["L-BFGS, before end-to-end"].append(before)
                squares["L-BFGS, after end-to-end"].append(after)
                bar.update()
    seeds = tuple(arguments.seeds)
    rows = []
    for order, paper in orders.items():
        rows.append(
            Row(f"{order}: mean squared distance, median", paper, float(np.median(squares[order])), "px^2", seeds)
        )
        rows.append(Row(f"{order}: mean squared distance, worst", None, float(np.max(squares[order])), "px^2", seeds))
    rows.append(Row("after end-to-end: mean distance, worst", None, float(np.max(distances)), "px", seeds))
    draw_bars(
        arguments.out / "stages.png",
        list(orders),
        {"paper": list(orders.values()), "ours, median": [float(np.median(v)) for v in squares.values()]},
        title=f"Stages (Tables 1, 2), {len(runs)} data sets of {arguments.samples} samples",
        y_label="mean squared distance [px^2]",
    )
    return rows


def _end_to_end(report: Any, observations: "Observations") -> tuple[float, float]:
    """Mean squared distance [px^2] before and after the stage that learns everything."""
    stage = next(stage for stage in report.stages if stage.name == "end to end")
    count = observations.seen.sum()
    return stage.initial_loss / count, stage.loss / count


def _from_random(trial: Trial, observations: "Observations", *, reconstructed: bool) -> float:
    """Mean squared distance [px^2] after fitting all parameters at once from random kinematics.

    Starts are drawn until every feature is before the cameras; no loss is finite elsewhere.

    Args:
        reconstructed: whether cameras and structure are learned first; random too if not.
    """
    from dense_vs.generative.learning.end_to_end import all_shared, fit_pixels
    from dense_vs.generative.least_squares.pixel_problem import PixelProblem
    from dense_vs.generative.reconstruction.bundle_adjustment import adjust_bundle
    from dense_vs.generative.reconstruction.initialization import guessed_intrinsics
    from dense_vs.generative.reconstruction.stereo import reconstruct

    rng = trial.rng(3)
    joints, pixels = observations.joints, observations.pixels
    guess = guessed_intrinsics(observations)
    found, intrinsics, _, _ = adjust_bundle(pixels, guess, next(reconstruct(pixels, guess, rng)))
    links = np.full(pixels.shape[2], joints.shape[1])
    problem = PixelProblem(pixels, links, joints.shape[1], all_shared(found.placed_cameras))
    for _ in range(STARTS):
        start = _random_start(found, joints, intrinsics if reconstructed else guess, rng, reconstructed)
        cost = float(fit_pixels(problem, joints, [start])[0].cost)
        if np.isfinite(cost):
            return cost / float(observations.seen.sum())
    return np.inf


def _random_start(
    found: Any, joints: np.ndarray, intrinsics: np.ndarray, rng: np.random.Generator, reconstructed: bool
) -> Any:
    from dense_vs.generative.learning.end_to_end import KinematicFit, initial_parameters
    from dense_vs.generative.rotations import rotation_matrices

    count = joints.shape[1]
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    # The unit is the reconstruction's; with nothing reconstructed any will do, so the arm is put 2 before camera 0.
    center = np.nanmean(found.translation, axis=0) if reconstructed else np.array([0.0, 0.0, 2.0])
    points = center + rng.normal(0.0, 0.3, (count, 3))
    start = initial_parameters(
        KinematicFit(axes, points, np.eye(3), center, np.nan), found, joints.mean(axis=0), intrinsics
    )
    if not reconstructed:
        start.features = center + rng.normal(0.0, 0.05, start.features.shape)
        others = range(1, len(start.intrinsics))
        start.camera_rotation = start.camera_rotation.copy()
        start.camera_translation = start.camera_translation.copy()
        for camera in others:  # a camera somewhere that has the hand before it
            start.camera_rotation[camera] = rotation_matrices(rng.normal(0.0, 0.6, 3))
            ahead = np.array([0.0, 0.0, np.linalg.norm(center)]) + rng.normal(0.0, 0.1, 3)
            start.camera_translation[camera] = ahead - start.camera_rotation[camera] @ center
    return start
