"""Command-line arguments that several commands share."""

import argparse


def add_device_arguments(parser: argparse.ArgumentParser) -> None:
    """``--device`` and ``--threads``."""
    parser.add_argument(
        "--device",
        default="auto",
        metavar="NAME",
        help="auto, cpu or cuda:N; auto takes a GPU where there is one (default: auto)",
    )
    parser.add_argument(
        "--threads", type=int, metavar="N", help="CPU threads (default: DENSE_VS_THREADS, else all allowed cores)"
    )
