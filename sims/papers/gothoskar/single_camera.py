"""Table 6, and learning from one camera: joints and reprojection from both images or one, models of one camera.

Table 6: a model of two cameras infers joints from the images of both or of one; the reprojection error is that of the
model's pixels at the inferred joints in both cameras, also in the one that was not used. Joints are inferred without
any reading, as in the paper; for seven joints they are not unique, so only the reprojection can be right. How well one
image determines the hand's depth depends on the hand's size in it, so two more errors are given: that of perfect
inference with a perfect model (Cramer-Rao), and the reprojection in the camera that was used. Learning: models of the
first camera alone.
"""

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_bars
from dense_vs.sims.papers.gothoskar.scores import pixel_error, spread_rows
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.evidence import Evidence

PAPER = {
    "both cameras: joints": (0.0536, 0.0134),
    "one camera: joints": (0.0519, 0.0095),
    "both cameras: reprojection": (1.1441, 0.1450),
    "one camera: reprojection": (1.6608, 0.2262),
}
PAPER_LEARNED = (1.231, 0.705)  # real robot, initialized by structure from motion


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=50, metavar="N", help="training samples (default: 50)")
    parser.add_argument(
        "--learn-from",
        type=int,
        nargs="+",
        default=[20, 30, 50],
        metavar="N",
        help="samples of one camera (default: 20 30 50)",
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel

    runs = trials(arguments)
    found: dict[str, dict[str, list[np.ndarray]]] = {arm: {} for arm in arguments.arm}
    learned: dict[int, list[float]] = {samples: [] for samples in arguments.learn_from}
    with progress("models", len(runs) * (1 + len(learned)), "model") as bar:
        for trial in runs:
            seen = trial.evidence(max([arguments.samples, *learned])).observations
            model = GenerativeModel.fit(seen[: arguments.samples], seed=trial.seed)
            held_out = trial.evidence(TEST_SAMPLES, 1)
            errors_by_name = _inferred(model, held_out) | _perfect(trial, held_out)
            for name, values in errors_by_name.items():
                found[trial.arm].setdefault(name, []).append(values)
            bar.update()
            for samples, errors in learned.items():
                few = seen[:samples]
                one = replace(
                    few, pixels=few.pixels[:, :1], image_sizes=few.image_sizes[:1], intrinsics=few.intrinsics[:1]
                )
                alone = GenerativeModel.fit(one, seed=trial.seed)
                test = held_out.observations
                errors.append(pixel_error(alone.pixels(test.joints), test.pixels[:, :1]))
                bar.update()
    rows: list[Row] = []
    bars: dict[str, list[float]] = {"paper": [value[0] for value in PAPER.values()]}
    for arm, figures in found.items():
        for name, values in figures.items():
            pooled, unit = np.concatenate(values), "rad" if "joints" in name else "px"
            seeds = tuple(arguments.seeds)
            paper = PAPER.get(name, (None, None))[0]
            rows.append(Row(f"{arm}: {name}: mean", paper, float(np.mean(pooled)), unit, seeds))
            rows.append(Row(f"{arm}: {name}: median", None, float(np.median(pooled)), unit, seeds))
        bars[f"{arm}, mean"] = [float(np.mean(np.concatenate(figures[name]))) for name in PAPER]
        bars[f"{arm}, perfect, mean"] = [
            float(np.mean(np.concatenate(figures.get(f"{name}, perfect", [np.array([np.nan])])))) for name in PAPER
        ]
    for samples, errors in learned.items():
        paper = PAPER_LEARNED if samples == 50 else (None, None)
        rows += spread_rows(f"learned from one camera, {samples} samples", paper, errors, "px", arguments.seeds)
    title = f"Inference from both images or one (Table 6), {TEST_SAMPLES} images a model"
    draw_bars(arguments.out / "single_camera.png", list(PAPER), bars, title=title, y_label="rad or px")
    return rows


def _inferred(model: "GenerativeModel", held_out: "Evidence") -> dict[str, np.ndarray]:
    """Errors (images,) of the joints inferred from both images and from the first alone, by the names of ``PAPER``."""
    observations, exact = held_out.observations, np.asarray(held_out.truth.joints)
    one = observations.pixels.copy()
    one[:, 1:] = np.nan
    enough = _enough(held_out)  # the same images for both
    errors = {}
    for name, pixels in (("both cameras", observations.pixels), ("one camera", one)):
        joints = model.infer_joints(pixels[enough])
        off = np.angle(np.exp(1j * (joints - exact[enough])))
        errors[f"{name}: joints"] = np.linalg.norm(off, axis=1)
        pairs = zip(model.pixels(joints), observations.pixels[enough], strict=True)
        errors[f"{name}: reprojection"] = np.array([pixel_error(a, b) for a, b in pairs])
    used = zip(model.pixels(joints)[:, :1], one[enough, :1], strict=True)
    errors["one camera: reprojection in it"] = np.array([pixel_error(a, b) for a, b in used])
    return errors


def _perfect(trial: Trial, held_out: "Evidence") -> dict[str, np.ndarray]:
    """Errors (images,) of perfect inference from the same images."""
    from dense_vs.sims.marked_arm.cramer_rao import perfect_inference

    errors = {}
    for name, cameras in (("both cameras", np.ones(trial.cameras, bool)), ("one camera", np.arange(trial.cameras) < 1)):
        joints, pixels = perfect_inference(held_out, cameras)
        enough = _enough(held_out)
        if trial.arm == "ur5":  # seven joints are not unique
            errors[f"{name}: joints, perfect"] = joints[enough]
        errors[f"{name}: reprojection, perfect"] = pixels[enough]
    return errors


def _enough(held_out: "Evidence") -> np.ndarray:
    """Images (T,) in which the first camera sees enough to infer joints from."""
    return np.isfinite(held_out.observations.pixels[:, 0, :, 0]).sum(axis=1) >= 4
