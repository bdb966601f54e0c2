"""Table 5 and Fig. 3: error on 100 held-out samples of models learned from few samples.

The smaller sets are beginnings of the larger ones. Rows of "lens tolerances given" stand for a learner that is told how
far off the maker's figures of the lenses may be, those of "not given" for one that is not; --tolerances picks one.
Beside each error stands the Cramer-Rao bound: what a perfect fit to the same samples, told the same, would have, the
mean over what noise does to it, and how many perfect fits would be below 1 and 2 px.
"""

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import TEST_SAMPLES, Trial, add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_lines, draw_points
from dense_vs.sims.papers.gothoskar.scores import bound_rows, held_out_error, share_rows, spread_rows
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

if TYPE_CHECKING:
    from dense_vs.sims.marked_arm.evidence import Evidence

PAPER = {30: (49.3582, 43.5229), 40: (3.2066, 2.3041), 50: (0.6235, 0.0143), 60: (0.6168, 0.0082), 70: (0.5991, 0.0082)}
LIMITS_PX = (1.0, 2.0)
TOLERANCES = {"known": "lens tolerances given", "unknown": "lens tolerances not given"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument(
        "--samples",
        type=int,
        nargs="+",
        default=[10, 15, 20, 30, 40, 50, 60, 70],
        metavar="N",
        help="training samples (default: 10 15 20 30 40 50 60 70)",
    )
    parser.add_argument(
        "--tolerances",
        default="both",
        choices=("both", *TOLERANCES),
        help="whether the learner knows how far the stated focal lengths (1 %%) and centers (8 px) of the lenses may "
        "be off (default: both)",
    )
    parser.add_argument("--kinematics", default="poe", choices=("poe", "dh"), help="form of the chain (default: poe)")
    add_trial_arguments(parser)


@dataclass
class Errors:
    """Errors [px] of one number of samples, a value a trial, and of perfect fits to the same samples, an array each."""

    training: list[float]
    validation: list[float]
    perfect: list[np.ndarray]


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    runs = trials(arguments)
    told = list(TOLERANCES) if arguments.tolerances == "both" else [arguments.tolerances]
    errors = {(name, samples): Errors([], [], []) for name in told for samples in arguments.samples}
    with progress("fits", len(runs) * len(errors), "fit") as bar:
        for trial in runs:
            held_out = trial.evidence(TEST_SAMPLES, 1)
            for name in told:
                seen = trial.evidence(max(arguments.samples), tolerances_known=name == "known")
                for samples in arguments.samples:
                    add_errors(errors[name, samples], trial, seen.first(samples), held_out, arguments.kinematics)
                    bar.update()
    rows: list[Row] = []
    for (name, samples), found in errors.items():
        figure = f"validation error, {samples} samples, {TOLERANCES[name]}"
        rows += spread_rows(figure, PAPER.get(samples, (None, None)), found.validation, "px", arguments.seeds)
        rows += bound_rows(figure, found.perfect, arguments.seeds)
        for limit in LIMITS_PX:
            rows += share_rows(figure, limit, np.array(found.validation), found.perfect, arguments.seeds)
    _draw(arguments, errors, told, len(runs))
    return rows


def add_errors(errors: Errors, trial: Trial, seen: "Evidence", held_out: "Evidence", kinematics: str) -> None:
    """Learn from ``seen`` and score on ``held_out``, which the model has not seen."""
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.cramer_rao import cramer_rao

    errors.perfect.append(cramer_rao(seen, held_out, trial.rng(4)).noisy)
    model = GenerativeModel.fit(seen.observations, kinematics=kinematics, seed=trial.seed)
    errors.training.append(held_out_error(model, seen.observations))
    errors.validation.append(held_out_error(model, held_out.observations))


def _draw(arguments: argparse.Namespace, errors: dict[tuple[str, int], Errors], told: list[str], models: int) -> None:
    sizes = arguments.samples
    series = {}
    for name in told:
        own = [errors[name, samples] for samples in sizes]
        series[f"validation, {TOLERANCES[name]}"] = (sizes, np.array([e.validation for e in own]).T)
        series[f"training, {TOLERANCES[name]}"] = (sizes, np.array([e.training for e in own]).T)
        series[f"validation of perfect fits, {TOLERANCES[name]}"] = (
            sizes,
            np.array([np.mean(e.perfect, axis=1) for e in own]).T,
        )
    draw_lines(
        arguments.out / "few_samples.png",
        series,
        title=f"Median and range over {models} models ({', '.join(arguments.arm)})",
        x_label="training samples",
        y_label="mean pixel error [px]",
        paper={"paper (Table 5, simulation)": (list(PAPER), [value[0] for value in PAPER.values()])},
        levels={"noise of the pixels": 0.627},
    )
    draw_points(
        arguments.out / "train_test.png",
        {
            f"{samples} samples, {TOLERANCES[name]}": (np.array(e.training), np.array(e.validation))
            for (name, samples), e in errors.items()
        },
        title=f"Training and validation error of {models * len(errors)} models (Fig. 3)",
        x_label="training error [px]",
        y_label="validation error [px]",
    )
