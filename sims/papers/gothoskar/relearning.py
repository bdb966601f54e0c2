"""Figs. 4 to 7: one part of a learned model relearned from few samples, the rest kept.

Fig. 4: one of two cameras was moved elsewhere, or a third was added. Fig. 5: the hand carries other features. Fig. 6:
the base was moved by centimeters and degrees. Fig. 7: the kinematics are learned again. The error is that on 100
samples of the new setup that were not learned from; of a new structure, over the features that the samples showed.
The paper only draws its figures, so it gives no numbers to compare with. A sample counts for a camera if that camera
sees 4 features in it; beside its errors stands the Cramer-Rao bound, what a perfect fit of its pose to the same samples
would have.
"""

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines
from dense_vs.sims.papers.gothoskar.scores import bound_rows, pixel_error, share_rows, spread_rows
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel, Observations
    from dense_vs.sims.marked_arm.evidence import Evidence

PARTS = {
    "moved camera": "camera:1",
    "added camera": "camera:2",
    "structure": "structure",
    "base": "base",
    "kinematics": "kinematics",
}
LIMIT_PX = 2.0
CAMERAS = {"moved camera": 1, "added camera": 2}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument(
        "--samples", type=int, default=50, metavar="N", help="training samples of the model (default: 50)"
    )
    parser.add_argument(
        "--relearn-from",
        type=int,
        nargs="+",
        default=[2, 3, 4, 5, 7, 10, 15, 20, 30],
        metavar="N",
        help="samples of the new setup (default: 2 3 4 5 7 10 15 20 30)",
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.cramer_rao import cramer_rao

    if arguments.cameras != 2:
        raise DenseVSError(f"--cameras is {arguments.cameras}; this experiment moves one of 2 and adds a third")
    runs, counts = trials(arguments), arguments.relearn_from
    errors = np.full((len(PARTS), len(runs), len(counts)), np.inf)
    perfect: dict[tuple[str, int], list[np.ndarray]] = {}
    with progress("relearning", len(runs) * len(PARTS), "part") as bar:
        for r, trial in enumerate(runs):
            observations = trial.evidence(arguments.samples).observations
            model = GenerativeModel.fit(observations, seed=trial.seed)
            for p, part in enumerate(PARTS):
                seen, held_out = new_setup(trial, part, observations.intrinsics[:, :4], max(counts))
                errors[p, r] = relearned_errors(model, part, seen.observations, held_out.observations, counts)
                for samples in counts if part in CAMERAS else ():
                    bound = cramer_rao(seen.first(samples), held_out, trial.rng(4), camera=CAMERAS[part]).noisy
                    perfect.setdefault((part, samples), []).append(bound)
                bar.update()
    rows = []
    for p, part in enumerate(PARTS):
        for s, samples in enumerate(counts):
            failed = float(np.mean(~np.isfinite(errors[p, :, s])))
            name = f"{part}, {samples} samples"
            if failed:
                rows.append(Row(f"{name}: share refused", None, failed, "", tuple(arguments.seeds)))
            done = errors[p, np.isfinite(errors[p, :, s]), s]
            if len(done):
                rows += spread_rows(name, (None, None), done, "px", arguments.seeds)
            if (part, samples) in perfect:
                rows += bound_rows(name, perfect[part, samples], arguments.seeds)
                rows += share_rows(name, LIMIT_PX, errors[p, :, s], perfect[part, samples], arguments.seeds)
    draw_lines(
        arguments.out / "relearning.png",
        {part: (counts, errors[p]) for p, part in enumerate(PARTS)},
        title=f"Parts relearned (Figs. 4-7), median and range over {len(runs)} models",
        x_label="samples of the new setup",
        y_label="error on other samples of it [px]",
        levels={"noise of the pixels": 0.627},
    )
    return rows


def new_setup(trial: Trial, part: str, intrinsics: np.ndarray, samples: int) -> tuple["Evidence", "Evidence"]:
    """Samples of the trial's arm after the change that makes the part wrong: to learn it from, and to test with.

    Args:
        trial: the arm before.
        part: a name of ``PARTS``.
        intrinsics: guesses (c, 4) of the cameras that there were.
        samples: to learn from.
    """
    from dense_vs.sims.marked_arm.evidence import draw_joints, guessed_intrinsics, observe

    rng = trial.rng(20 + list(PARTS).index(part))
    arm = _changed(trial, part, rng)
    if len(arm.cameras) > len(intrinsics):
        intrinsics = np.concatenate([intrinsics, guessed_intrinsics(arm, rng)[len(intrinsics) :]])
    seen = observe(arm, draw_joints(arm, samples, rng, trial.postures, CAMERAS.get(part)), rng, intrinsics=intrinsics)
    return seen, observe(arm, draw_joints(arm, TEST_SAMPLES, rng, trial.postures), rng, intrinsics=intrinsics)


def relearned_errors(
    model: "GenerativeModel", part: str, seen: "Observations", held_out: "Observations", counts: list[int]
) -> list[float]:
    """Error [px] after relearning from each number of samples; infinite where the samples were refused."""
    from dense_vs.generative import GenerativeModel

    errors = []
    for samples in counts:
        report = replace(model.report)
        again = GenerativeModel(model.parameters.copy(), model.postures, report, image_sizes=model.image_sizes)
        try:
            again.relearn(seen[:samples], PARTS[part])
        except DenseVSError:
            errors.append(np.inf)
            continue
        generated = again.pixels(held_out.joints)
        known = np.isfinite(again.parameters.features).all(axis=1)
        errors.append(pixel_error(generated[:, :, known], held_out.pixels[:, :, known]))
    return errors


def _changed(trial: Trial, part: str, rng: np.random.Generator) -> Any:
    """The arm of the trial after the change that makes the part wrong."""
    from dense_vs.sims.marked_arm.observed_arm import make_observed_arm

    arm = trial.observed_arm()
    if part == "moved camera":
        return replace(arm, cameras=(arm.cameras[0], arm.cameras[1].shifted(rng, 0.1, 0.15)))
    if part == "added camera":
        third = make_observed_arm(trial.arm, seed=trial.seed + 1000, cameras=1).cameras
        return replace(arm, cameras=arm.cameras + third)
    if part == "structure":
        other = make_observed_arm(trial.arm, seed=trial.seed, cameras=2, feature_seed=trial.seed + 1000)
        return replace(arm, features=other.features, normals=other.normals)
    if part == "base":
        # A base that moves one way is the same to the images as cameras that move the other way.
        move = np.eye(4)
        move[:3, :3] = Rotation.from_rotvec(rng.normal(0.0, 0.03, 3)).as_matrix()
        move[:3, 3] = rng.normal(0.0, 0.03, 3)
        return replace(arm, cameras=tuple(replace(c, T_camera_world=c.T_camera_world @ move) for c in arm.cameras))
    return arm
