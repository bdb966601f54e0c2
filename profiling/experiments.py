"""Add what ``dense-vs reproduce --json`` wrote to the committed results, from which the tables of figures are made.

    python profiling/experiments.py FILE [FILE ...]

A run replaces the one of the same paper, experiment, seeds and arguments in ``profiling/results/experiments.json``.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

# What runs were asked for before they could say so.
EARLIER = {"trial": {"difficulty": "clean", "mask_seconds": None, "objects": None}}
RESULTS = Path(__file__).parent / "results" / "experiments.json"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Add the figures of reproduced experiments to the results.")
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="that --json wrote")
    runs = json.loads(RESULTS.read_text(encoding="utf-8"))["runs"]
    for file in parser.parse_args().files:
        new = json.loads(file.read_text(encoding="utf-8"))
        runs = [run for run in runs if not _replaces(new, run)] + [new]
    runs.sort(key=lambda run: (run["paper"], run["experiment"], run["seeds"]))
    rows = ",\n".join("  " + json.dumps(run) for run in runs)
    RESULTS.write_text(f'{{"runs": [\n{rows}\n]}}\n', encoding="utf-8")
    return 0


def _replaces(new: dict[str, Any], old: dict[str, Any]) -> bool:
    """Whether both were asked for the same; a run that does not say its arguments is taken for the same."""
    same = all(new[name] == old[name] for name in ("paper", "experiment", "seeds"))
    return same and ("arguments" not in old or _told(new) == _told(old))


def _told(run: dict[str, Any]) -> dict[str, Any]:
    """Arguments but threads, processes and device, which do not change what was asked for."""
    arguments = {**EARLIER.get(run["experiment"], {}), **run["arguments"]}
    return {name: value for name, value in arguments.items() if name not in ("threads", "jobs", "device")}


if __name__ == "__main__":
    sys.exit(main())
