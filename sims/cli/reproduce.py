"""``dense-vs reproduce PAPER EXPERIMENT``: repeat a published experiment in simulation, paper's figures beside ours."""

import argparse
import time
from importlib import import_module
from pathlib import Path

from dense_vs.cli.options import add_device_arguments
from dense_vs.cli.parsing import LazyParser, from_module
from dense_vs.sims.papers import PAPERS

MOST_SEED = (1 << 32) - 1  # of what experiments learn masks with


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare a subcommand a paper and, below it, one an experiment; an experiment's module is imported when chosen."""
    papers = parser.add_subparsers(dest="paper", required=True, metavar="PAPER")
    for paper, (help_line, experiments) in PAPERS.items():
        of_paper = papers.add_parser(paper, help=help_line, description=help_line[:1].upper() + help_line[1:] + ".")
        names = of_paper.add_subparsers(dest="experiment", required=True, metavar="EXPERIMENT")
        for name, experiment in experiments.items():
            shared = _SharedArguments(Path("out") / paper / name)
            names.add_parser(name, help=experiment.help, fill=from_module(experiment.home, shared))


class _SharedArguments:
    """Declares what every experiment takes.

    Args:
        out: where an experiment writes its pictures unless told.
    """

    def __init__(self, out: Path):
        self._out = out

    def __call__(self, parser: LazyParser) -> None:
        parser.add_argument(
            "--seed", type=int, nargs="+", default=[0], metavar="N", dest="seeds", help="repeat for these (default: 0)"
        )
        parser.add_argument(
            "--out", type=Path, default=self._out, metavar="DIR", help=f"folder for the pictures (default: {self._out})"
        )
        parser.add_argument(
            "--json", type=Path, metavar="FILE", help="write the figures here, with date, commit, arguments and machine"
        )
        add_device_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    # Not above: 'dense-vs reproduce --help' lists papers and experiments without them.
    from dense_vs.checks import check_whole
    from dense_vs.files import check_writable, output_folder, write_json
    from dense_vs.sims.papers.rows import rows_json, rows_table
    from dense_vs.view.provenance import provenance

    for seed in arguments.seeds:
        check_whole("--seed", seed, least=0, most=MOST_SEED)
    arguments.out = output_folder(arguments.out)
    if arguments.json is not None:
        output_folder(arguments.json.parent)
        check_writable(arguments.json)
    started = time.perf_counter()
    rows = import_module(PAPERS[arguments.paper].experiments[arguments.experiment].home).run(arguments)
    seconds = time.perf_counter() - started
    print(rows_table(rows))
    print(f"{seconds:.0f} s; pictures in {arguments.out}")
    if arguments.json is not None:
        content = {
            "paper": arguments.paper,
            "experiment": arguments.experiment,
            "rows": rows_json(rows),
            "seeds": arguments.seeds,
            "seconds": seconds,
            **provenance(
                arguments, leave_out=("command", "home", "paper", "experiment", "seeds", "out", "json", "keep")
            ),
        }
        write_json(arguments.json, content)
