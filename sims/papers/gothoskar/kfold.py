"""Table 4: k-fold cross validation on 200 samples.

The paper's sizes: the folds train on all but one k-th. Values are those of the folds of all seeds and arms.
"""

import argparse

import numpy as np

from dense_vs.sims.papers.gothoskar.arm_trials import add_trial_arguments, trials
from dense_vs.sims.papers.gothoskar.figures import draw_bars
from dense_vs.sims.papers.gothoskar.scores import held_out_error, spread_rows
from dense_vs.sims.papers.rows import Row
from dense_vs.view.progress import progress

PAPER = {2: (0.5600, 0.0205), 3: (0.5502, 0.0417), 4: (0.5577, 0.0663), 5: (0.6368, 0.2268), 6: (0.5445, 0.0667)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the experiment's arguments."""
    parser.add_argument("--samples", type=int, default=200, metavar="N", help="of the data set (default: 200)")
    parser.add_argument(
        "--folds",
        type=int,
        nargs="+",
        default=list(PAPER),
        metavar="N",
        help="parts that the data set is cut into (default: 2 3 4 5 6)",
    )
    add_trial_arguments(parser)


def run(arguments: argparse.Namespace) -> list[Row]:
    """Run the experiment."""
    from dense_vs.generative import GenerativeModel

    runs = trials(arguments)
    errors: dict[int, list[float]] = {k: [] for k in arguments.folds}
    with progress("fits", sum(arguments.folds) * len(runs), "fit") as bar:
        for trial in runs:
            observations = trial.evidence(arguments.samples).observations
            order = trial.rng(2).permutation(arguments.samples)
            for k in arguments.folds:
                for fold in np.array_split(order, k):
                    train = np.setdiff1d(order, fold)
                    model = GenerativeModel.fit(observations[train], seed=trial.seed)
                    errors[k].append(held_out_error(model, observations[np.sort(fold)]))
                    bar.update()
    rows = []
    for k, values in errors.items():
        rows += spread_rows(f"k = {k}", PAPER.get(k, (None, None)), values, "px", arguments.seeds)
    draw_bars(
        arguments.out / "kfold.png",
        [f"k = {k}" for k in errors],
        {
            "paper": [PAPER.get(k, (np.nan, 0))[0] for k in errors],
            "ours, mean": [float(np.mean(values)) for values in errors.values()],
            "ours, worst": [float(np.max(values)) for values in errors.values()],
        },
        title="Error on the fold left out (Table 4)",
        y_label="mean pixel error [px]",
        logarithmic=False,
    )
    return rows
