"""A sweep of small tasks with one job and with two: how much faster it ends.

    python profiling/sweep.py [--tasks 24] [--json FILE]

Every task learns an arm's generative model from a few images, in a process of its own with the cores shared out.
"""

import argparse
import tempfile
import time
from pathlib import Path

from metrics import Metric, add_report_arguments, report

from dense_vs.kernels.launch import available_cores
from dense_vs.sweep.run_sweep import run_sweep
from dense_vs.sweep.task import Task


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Time of a sweep with one job and with two.")
    parser.add_argument("--tasks", type=int, default=24, help="tasks (default: 24)")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    command = ("reproduce", "gothoskar", "few-samples", "--device", "cpu", "--arm", "ur5")
    tasks = [
        Task(f"seed-{seed}", "few-samples", (*command, "--seed", str(seed)), seed) for seed in range(arguments.tasks)
    ]
    seconds = {}
    for jobs in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            started = time.perf_counter()
            outcomes = run_sweep(tasks, Path(folder), jobs=jobs)
            seconds[jobs] = time.perf_counter() - started
        if failed := [outcome.failure for outcome in outcomes if outcome.failure]:
            raise SystemExit(f"{len(failed)} tasks failed: {failed[0]}")
    metrics = [
        Metric(f"sweep of {len(tasks)} tasks, one job", seconds[1], "s", "lower", 0.3),
        Metric(f"sweep of {len(tasks)} tasks, two jobs", seconds[2], "s", "lower", 0.3),
        Metric(f"two jobs: times as fast, {available_cores()} cores", seconds[1] / seconds[2], "1", "higher", 0.1),
    ]
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
