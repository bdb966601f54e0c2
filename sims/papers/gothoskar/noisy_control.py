"""Figs. 10 and 11: learning from the actions sent to a noisy controller and images alone, then servoing with it.

The state is never read, neither for learning (50 samples) nor for servoing. Fig. 10: a Cartesian controller, noise in m
and rad. Fig. 11: a joint controller, noise in rad. Both laws of ``sims/marked_arm/noise.py`` are run. With independent
noise on every move, the paper's law, no servo can end closer than one move's noise allows; that floor is given too.

The joint model's own error is that on exact pixels of other postures, once its joints' constant offsets, which actions
leave open, are taken out. Beside it stand that of a model which takes the actions for exact, and under independent
noise the Cramer-Rao bound, the error of a perfect fit to the same samples.
"""

import argparse
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines
from dense_vs.sims.papers.gothoskar.scores import pixel_error
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.evidence import Evidence
    from dense_vs.sims.marked_arm.noise import NoisyController

CONTROLLERS = {"cartesian": "Fig. 10", "joint": "Fig. 11"}
# Fig. 10 in words: "pixel accuracy" at 0.01, "approximately 5 pixel accuracy" at 0.02.
PAPER_FINAL_PX = {("cartesian", 0.02): 5.0}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=50, metavar="N", help="training samples (default: 50)")
    parser.add_argument("--targets", type=int, default=50, metavar="N", help="targets a seed and arm (default: 50)")
    parser.add_argument("--moves", type=int, default=10, metavar="N", help="servo moves (default: 10)")
    parser.add_argument(
        "--sigma",
        type=float,
        nargs="+",
        default=[0.0, 0.01, 0.02],
        metavar="RAD",
        help="noise of a move: of the joints [rad], of the hand [m, rad] (default: 0 0.01 0.02)",
    )
    parser.add_argument(
        "--controller",
        nargs="+",
        default=list(CONTROLLERS),
        choices=list(CONTROLLERS),
        help="which controllers are learned from (default: both)",
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.sims.marked_arm.noise import LAWS

    runs = trials(arguments)
    total = len(runs) * len(arguments.controller) * len(LAWS) * len(arguments.sigma)
    rows: list[Row] = []
    with progress("models", total, "model") as bar:
        for controller in arguments.controller:
            for law in LAWS:
                curves = {}
                for sigma in arguments.sigma:
                    done = []
                    for trial in runs:
                        done.append(_servo(trial, controller, law, sigma, arguments))
                        bar.update()
                    curves[f"{sigma:g}"] = np.concatenate([servo.errors for servo in done])
                    rows += _rows(controller, law, sigma, done, tuple(arguments.seeds))
                moves = range(arguments.moves + 1)
                draw_lines(
                    arguments.out / f"{controller}_{law}.png",
                    {f"noise {name}": (moves, np.median(table, axis=0)[None]) for name, table in curves.items()},
                    title=f"{controller} controller, noise {law}, learned from actions ({CONTROLLERS[controller]})",
                    x_label="servo moves",
                    y_label="true pixel error, median [px]",
                )
    return rows


@dataclass
class _Servo:
    """Errors of one trial of one controller [px]; NaN where one was not asked for."""

    errors: np.ndarray  # (targets, moves + 1)
    floor: float  # that a perfect move leaves
    model: float = np.nan
    unmodeled: float = np.nan
    perfect: float = np.nan


def _servo(trial: Trial, controller: str, law: str, sigma: float, arguments: argparse.Namespace) -> _Servo:
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.cramer_rao import cramer_rao
    from dense_vs.sims.marked_arm.evidence import act, act_cartesian
    from dense_vs.sims.marked_arm.noise import NoisyController
    from dense_vs.sims.papers.gothoskar.servo_runs import (
        cartesian_tasks,
        joint_tasks,
        servo_model,
        servo_model_cartesian,
    )

    arm, rng = trial.observed_arm(), trial.rng(60)
    noisy = NoisyController(sigma, law, rng)
    # The fit supposes noise of one size for all steps under either law; the servo's law is not known to it.
    if controller == "cartesian":
        observations = act_cartesian(arm, arguments.samples, noisy, rng).observations
        model = GenerativeModel.fit(observations, state="actions", controller=controller, seed=trial.seed)
        tasks = cartesian_tasks(arm, arguments.targets, rng)
        errors = servo_model_cartesian(model, arm, tasks, arguments.moves, rng, noisy)
        return _Servo(errors, _floor(trial, noisy, controller, rng))
    learned_from = act(arm, arguments.samples, noisy, rng, trial.postures)
    model = GenerativeModel.fit(learned_from.observations, state="actions", seed=trial.seed)
    tasks = joint_tasks(arm, arguments.targets, rng, trial.postures)
    errors = servo_model(model, arm, tasks, arguments.moves, rng, noisy, None)
    held_out = trial.evidence(TEST_SAMPLES, 1)
    done = _Servo(errors, _floor(trial, noisy, controller, rng), _aligned_error(model, learned_from, held_out))
    added = np.cumsum(learned_from.observations.actions, axis=0)
    believed = replace(learned_from.observations, joints=np.concatenate([np.zeros((1, added.shape[1])), added]))
    done.unmodeled = _aligned_error(GenerativeModel.fit(believed, seed=trial.seed), learned_from, held_out)
    if law == "independent" and sigma > 0:
        perfect = cramer_rao(learned_from, held_out, trial.rng(4), state="actions", sigma=sigma)
        done.perfect = float(np.mean(perfect.exact))
    return done


def _aligned_error(model: "GenerativeModel", learned_from: "Evidence", held_out: "Evidence") -> float:
    """Error [px] on exact postures and pixels, the mean offset of each joint from the true one taken out."""
    assert learned_from.truth.joints is not None
    assert held_out.truth.joints is not None
    offset = np.mean(learned_from.truth.joints - model.postures, axis=0)
    return pixel_error(model.pixels(held_out.truth.joints - offset), held_out.truth.pixels)


def _floor(trial: Trial, noisy: "NoisyController", controller: str, rng: np.random.Generator) -> float:
    """Median error [px] of perfect commands of no motion: what independent noise leaves."""
    from dense_vs.sims.marked_arm.evidence import draw_joints, executed

    arm = trial.observed_arm()
    joints = draw_joints(arm, 100, rng, trial.postures)
    poses = arm.chain.flange_pose(joints)
    if controller == "joint":
        moved = arm.chain.flange_pose(np.stack([q + noisy.joint_step(np.zeros_like(q)) for q in joints]))
    else:
        moved = np.stack([executed(noisy, np.eye(4), pose) for pose in poses])
    exact = arm.pixels_of_poses(poses)
    after = arm.projections(moved)
    return float(np.median([pixel_error(a, e) for a, e in zip(after, exact, strict=True)]))


def _rows(controller: str, law: str, sigma: float, done: list[_Servo], seeds: tuple[int, ...]) -> list[Row]:
    from dense_vs.sims.papers.gothoskar.servo_runs import moves_needed

    errors = np.concatenate([servo.errors for servo in done])
    needed = moves_needed(errors)
    paper = PAPER_FINAL_PX.get((controller, sigma)) if law == "independent" else None
    start = f"{controller}, {law} noise {sigma:g}:"
    rows = [
        Row(f"{start} error after the last move, median", paper, float(np.median(errors[:, -1])), "px", seeds),
        Row(f"{start} share ever below 1 px", None, float(np.mean(np.isfinite(needed))), "", seeds),
        Row(f"{start} moves to below 1 px, median", None, float(np.median(needed)), "", seeds),
    ]
    if controller == "joint":
        for name, values in (
            ("", [servo.model for servo in done]),
            (" that takes actions for exact", [servo.unmodeled for servo in done]),
            (", bound (Cramer-Rao)", [servo.perfect for servo in done]),
        ):
            if np.isfinite(values).all():
                mean, worst = float(np.mean(values)), float(np.max(values))
                rows.append(Row(f"{start} error of the model{name}, mean", None, mean, "px", seeds))
                rows.append(Row(f"{start} error of the model{name}, worst", None, worst, "px", seeds))
    if law == "independent":
        floor = float(np.mean([servo.floor for servo in done]))
        rows.append(Row(f"{start} what one move's noise leaves, median", None, floor, "px", seeds))
    return rows
