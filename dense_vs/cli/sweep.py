"""``dense-vs sweep``: run a command over seeds and options, on several cores or a Ray cluster.

SWEEP.toml names commands, options and seeds; a list of options is swept over:

    [[experiment]] command = "reach", seeds = "0:8", options = { robot = ["arm", "planar"], targets = 3 }

(each of the three on a line of its own in the file). Every run is a process of its own whose result is found again: the
same sweep run once more does only what is missing, and other code or other options count as missing.
"""

import argparse
import io
from contextlib import redirect_stderr
from pathlib import Path

from dense_vs.checks import check_whole
from dense_vs.cli.options import add_cluster_arguments
from dense_vs.errors import DenseVSError
from dense_vs.files import write_json
from dense_vs.sweep.figures import Figure, gathered
from dense_vs.sweep.plan import read_plan
from dense_vs.sweep.report import draw_figures, figures_table, raise_failures
from dense_vs.sweep.run_sweep import run_sweep
from dense_vs.sweep.task import Outcome, Task
from dense_vs.view.provenance import provenance


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("plan", type=Path, metavar="SWEEP.toml", help="what to run")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    add_cluster_arguments(parser)
    parser.add_argument("--threads", type=int, metavar="N", help="CPU threads a run (default: the cores shared out)")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    tasks = read_plan(arguments.plan)
    _check_commands(tasks)
    jobs = check_whole("--jobs", arguments.jobs, least=1)
    threads = None if arguments.threads is None else check_whole("--threads", arguments.threads, least=1)
    outcomes = run_sweep(tasks, arguments.out, jobs=jobs, address=arguments.address, threads=threads)
    finished = [outcome.task for outcome in outcomes if not outcome.failure]
    figures = gathered(arguments.out, finished)
    if figures:
        print(figures_table(figures))
        draw_figures(arguments.out, figures)
    write_json(arguments.out / "summary.json", _summary(arguments, outcomes, figures))
    before = sum(not outcome.seconds for outcome in outcomes if not outcome.failure)
    print(f"{len(finished)} of {len(tasks)} runs done, {before} of them before; results in {arguments.out}")
    raise_failures(outcomes)


def _check_commands(tasks: list[Task]) -> None:
    """Read every command line as the command itself will, so that a slip is found before the first run."""
    from dense_vs.cli.main import build_parser

    for task in tasks:
        said = io.StringIO()
        try:
            with redirect_stderr(said):
                build_parser().parse_args(task.command_line("out", "figures.json"))
        except SystemExit as error:
            lines = said.getvalue().strip().splitlines() or ["it ends at once"]
            raise DenseVSError(f"'{' '.join(task.arguments)}' cannot be run: {lines[-1]}") from error


def _summary(arguments: argparse.Namespace, outcomes: list[Outcome], figures: list[Figure]) -> dict[str, object]:
    return {
        "runs": [
            {
                "arguments": list(outcome.task.arguments),
                "result": None if outcome.failure else f"results/{outcome.task.name}",
                "failure": outcome.failure or None,
                "seconds": outcome.seconds or None,
            }
            for outcome in outcomes
        ],
        "figures": [
            {"group": one.group, "name": one.name, "seeds": one.seeds, "values": one.values} for one in figures
        ],
        **provenance(arguments, leave_out=("command", "home")),
    }
