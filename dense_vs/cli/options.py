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


def add_cluster_arguments(parser: argparse.ArgumentParser) -> None:
    """``--jobs`` and ``--address``."""
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="runs at once on this machine (default: 1)")
    parser.add_argument(
        "--address",
        metavar="WHERE",
        help="run on a Ray cluster: auto, local, HOST:PORT or ray://HOST:PORT; the folder of results must be on a disk "
        "that all of its machines see (default: this machine without Ray)",
    )
