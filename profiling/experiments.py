"""Gather what ``dense-vs reproduce --json`` wrote into one file of results, from which the README's table is made.

    python profiling/experiments.py FOLDER

Every ``*.json`` in FOLDER is taken, sorted by name; it replaces ``profiling/results/experiments.json``.
"""

import argparse
import json
import sys
from pathlib import Path

RESULTS = Path(__file__).parent / "results" / "experiments.json"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Gather the figures of reproduced experiments.")
    parser.add_argument("folder", type=Path, help="with the files that --json wrote")
    files = sorted(parser.parse_args().folder.glob("*.json"))
    if not files:
        print("no *.json there", file=sys.stderr)
        return 2
    runs = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    runs.sort(key=lambda run: (run["paper"], run["experiment"], run["seeds"]))
    rows = ",\n".join("  " + json.dumps(run) for run in runs)
    RESULTS.write_text(f'{{"runs": [\n{rows}\n]}}\n', encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
