"""Arguments of the experiments on self-recognition, apart from what needs a simulator."""

import argparse
import math

from dense_vs.errors import DenseVSError


def add_labelling_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what both experiments take."""
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="length of a run (default: 20)")
    parser.add_argument(
        "--period",
        type=float,
        default=0.7,
        metavar="S",
        help="seconds between commands (default: 0.7, as in the paper); 0 for a command every frame",
    )
    parser.add_argument(
        "--distractor",
        default="walker-behind",
        help="what passes by: walker-behind (default), walker-next, walker-across, the same of a chair, or none",
    )


def check_labelling_arguments(arguments: argparse.Namespace, least_seconds: float) -> None:
    """Refuse a time out of range.

    Raises:
        DenseVSError: saying so.
    """
    if not least_seconds <= arguments.seconds < math.inf:
        raise DenseVSError(f"--seconds is {arguments.seconds:g}; expected at least {least_seconds:g}")
    if not 0 <= arguments.period < math.inf:
        raise DenseVSError(f"--period is {arguments.period:g}; expected a number of at least 0")
