"""Table 5 and Fig. 3: error on 100 held-out samples of models learnt from few samples.

The smaller sets are beginnings of the larger ones. The learner knows how far off the maker's figures of the lenses may
be unless --tolerances is unknown. Beside each error stands the Cramer-Rao bound: what a perfect fit to the same samples
would have, the mean over what noise does to it, and how many perfect fits would be below 1 and 2 px.
"""

import argparse

import numpy as np

from dense_vs.sims.papers.gothoskar.chart import draw_lines, draw_points
from dense_vs.sims.papers.gothoskar.protocol import (
    TEST_SAMPLES,
    add_protocol_arguments,
    bound_rows,
    held_out_error,
    share_rows,
    spread_rows,
    trials,
)
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

HELP = "Table 5, Fig. 3: error against the number of training samples"
PAPER = {30: (49.3582, 43.5229), 40: (3.2066, 2.3041), 50: (0.6235, 0.0143), 60: (0.6168, 0.0082), 70: (0.5991, 0.0082)}
LIMITS_PX = (1.0, 2.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument(
        "--samples",
        type=int,
        nargs="+",
        default=[10, 15, 20, 30, 40, 50, 60, 70],
        metavar="T",
        help="training samples (default: 10 15 20 30 40 50 60 70)",
    )
    parser.add_argument(
        "--tolerances",
        default="known",
        choices=("known", "unknown"),
        help="of the lenses' stated focal lengths (1 %%) and centres (8 px) (default: known)",
    )
    parser.add_argument("--kinematics", default="poe", choices=("poe", "dh"), help="form of the chain (default: poe)")
    add_protocol_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel
    from dense_vs.sims.marked_arm.cramer_rao import cramer_rao

    runs, known = trials(arguments), arguments.tolerances == "known"
    train, test = np.zeros((2, len(runs), len(arguments.samples)))
    perfect: list[list[np.ndarray]] = [[] for _ in arguments.samples]
    with progress("fits", train.size, "fit") as bar:
        for r, trial in enumerate(runs):
            held_out = trial.evidence(TEST_SAMPLES, 1)
            seen = trial.evidence(max(arguments.samples), 0, tolerances_known=known)
            for s, samples in enumerate(arguments.samples):
                beginning = seen.first(samples)
                perfect[s].append(cramer_rao(beginning, held_out, trial.rng(4)).noisy)
                part = beginning.observations
                model = GenerativeModel.fit(part, kinematics=arguments.kinematics, seed=trial.seed)
                train[r, s], test[r, s] = held_out_error(model, part), held_out_error(model, held_out.observations)
                bar.update()
    rows: list[Row] = []
    for s, samples in enumerate(arguments.samples):
        name = f"validation error, {samples} samples"
        rows += spread_rows(name, PAPER.get(samples, (None, None)), test[:, s], "px", arguments.seeds)
        rows += bound_rows(name, perfect[s], arguments.seeds)
        for limit in LIMITS_PX:
            rows += share_rows(name, limit, test[:, s], perfect[s], arguments.seeds)
    draw_lines(
        arguments.out / "few_samples.png",
        {
            "validation": (arguments.samples, test),
            "training": (arguments.samples, train),
            "validation of perfect fits": (arguments.samples, np.mean(perfect, axis=2).T),
        },
        title=f"Median and range over {len(runs)} models ({', '.join(arguments.arm)})",
        x_label="training samples",
        y_label="mean pixel error [px]",
        paper={"paper (Table 5, simulation)": (list(PAPER), [value[0] for value in PAPER.values()])},
        levels={"noise of the pixels": 0.627},
    )
    draw_points(
        arguments.out / "train_test.png",
        {f"{samples} samples": (train[:, s], test[:, s]) for s, samples in enumerate(arguments.samples)},
        title=f"Training and validation error of {train.size} models (Fig. 3)",
        x_label="training error [px]",
        y_label="validation error [px]",
    )
    return rows
