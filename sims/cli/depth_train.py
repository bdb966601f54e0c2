"""``dense-vs depth-train``: train the learned depth from masks, on simulated mask sequences only.

The weights that the package ships were made by this command with its default arguments. It needs scikit-learn.
"""

import argparse
from pathlib import Path

from dense_vs.checks import check_seed, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import check_writable
from dense_vs.kernels.launch import available_cores
from dense_vs.sims.depth_training.training import simulated_features, train
from dense_vs.view.tables import table

MOST_JOBS = 1024


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--sequences", type=int, default=5000, metavar="N", help="sequences to simulate and train on (default: 5000)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of sequences and networks (default: 0)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="where to write the weights (.npz)")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes that simulate (default: all allowed cores)")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    if arguments.sequences < 200:
        raise DenseVSError(f"--sequences is {arguments.sequences}; expected at least 200")
    check_seed(arguments.seed)
    jobs = available_cores() if arguments.jobs is None else arguments.jobs
    check_whole("--jobs", jobs, least=1, most=MOST_JOBS)
    check_writable(arguments.out)  # else an hour later
    features, truth = simulated_features(arguments.sequences, arguments.seed, jobs)
    learned, figures = train(features, truth, arguments.seed)
    learned.save(arguments.out)
    print(table(["simulated sequences not trained on", "robust", "learned"], figures))
    print(f"{len(features)} of {arguments.sequences} sequences gave an estimate; weights in {arguments.out}")
