"""Arguments of the experiments on self-recognition, apart from what needs a simulator."""

import argparse

from dense_vs.checks import check_number

LONGEST = 1e5  # s, more than a day


def add_labeling_arguments(parser: argparse.ArgumentParser, seconds: float = 20.0) -> None:
    """Declare what both experiments take."""
    parser.add_argument(
        "--seconds", type=float, default=seconds, metavar="S", help=f"length of a run (default: {seconds:g})"
    )
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
        metavar="NAME",
        help="what passes by: walker-behind, walker-next, walker-across, the same of a chair, or none (default: "
        "walker-behind)",
    )


def check_labeling_arguments(arguments: argparse.Namespace, least_seconds: float) -> None:
    """Refuse a time out of range.

    Raises:
        DenseVSError: saying so.
    """
    check_number("--seconds", arguments.seconds, least=least_seconds, most=LONGEST)
    check_number("--period", arguments.period, least=0, most=LONGEST)
