"""How long the command line takes to list its commands, beside an interpreter that does nothing.

    python profiling/startup.py [--rounds 15] [--json FILE]

Wall time of whole processes, taken in turn.
"""

import argparse
import subprocess
import sys

import numpy as np
from interleaved import interleaved
from metrics import Metric, add_report_arguments, report

PROGRAM = [sys.executable, "-m", "dense_vs"]
COMMANDS = {
    "python -c pass": [sys.executable, "-c", "pass"],
    "dense-vs --help": [*PROGRAM, "--help"],
    "dense-vs reproduce --help": [*PROGRAM, "reproduce", "--help"],
    "dense-vs reproduce vosvs --help": [*PROGRAM, "reproduce", "vosvs", "--help"],
    "dense-vs estimate --help": [*PROGRAM, "estimate", "--help"],
    "dense-vs reach --help": [*PROGRAM, "reach", "--help"],
}


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Time of the command line's lists.")
    parser.add_argument("--rounds", type=int, default=15, help="runs of each (default: 15)")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    seconds = interleaved({name: _run(words) for name, words in COMMANDS.items()}, arguments.rounds, warmup=1)
    return report(
        [Metric(name, 1e3 * float(np.median(spent)), "ms", "lower", 0.2) for name, spent in seconds.items()], arguments
    )


def _run(words: list[str]):
    def run(_: int) -> None:
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)

    return run


if __name__ == "__main__":
    raise SystemExit(main())
