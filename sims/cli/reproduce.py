"""``dense-vs reproduce PAPER EXPERIMENT``: a published experiment on a simulated robot, paper's figures beside ours."""

import argparse
import time
from importlib import import_module
from pathlib import Path

from dense_vs.cli.help_text import ParagraphHelp, description
from dense_vs.cli.options import add_device_arguments
from dense_vs.files import write_json
from dense_vs.sims.papers import EXPERIMENTS
from dense_vs.view.provenance import versions

HELP = "repeat a paper's experiment on a simulated robot"
PAPERS = {
    "dije": "dense image Jacobian estimation: self-recognition, markerless servoing, tools",
    "generative": "the generative model: kinematics, structure and cameras learnt together",
    "vosvs": "servoing, depth and grasping from object masks",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare a subcommand a paper and, below it, one an experiment."""
    papers = parser.add_subparsers(dest="paper", required=True, metavar="PAPER")
    for paper, experiments in EXPERIMENTS.items():
        of_paper = papers.add_parser(paper, help=PAPERS[paper], description=PAPERS[paper].capitalize() + ".")
        names = of_paper.add_subparsers(dest="experiment", required=True, metavar="EXPERIMENT")
        for name, home in experiments.items():
            module = import_module(home)
            experiment = names.add_parser(
                name, help=module.HELP, description=description(module), formatter_class=ParagraphHelp
            )
            experiment.add_argument(
                "--seed", type=int, nargs="+", default=[0], metavar="N", dest="seeds", help="one or more (default: 0)"
            )
            experiment.add_argument(
                "--out", type=Path, default=Path("out") / paper / name, metavar="DIR", help="folder for the pictures"
            )
            experiment.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
            module.add_arguments(experiment)
            add_device_arguments(experiment)
            experiment.set_defaults(experiment_home=home)


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from dense_vs.files import output_folder
    from dense_vs.sims.papers.rows import rows_json, rows_table

    arguments.out = output_folder(arguments.out)
    if arguments.json is not None:
        output_folder(arguments.json.parent)
    started = time.perf_counter()
    rows = import_module(arguments.experiment_home).run(arguments)
    seconds = time.perf_counter() - started
    print(rows_table(rows))
    print(f"{seconds:.0f} s; pictures in {arguments.out}")
    if arguments.json is not None:
        content = {
            "paper": arguments.paper,
            "experiment": arguments.experiment,
            "rows": rows_json(rows),
            "seeds": arguments.seeds,
            "arguments": _own_arguments(arguments),
            "seconds": seconds,
            "versions": versions(),
        }
        write_json(arguments.json, content)


def _own_arguments(arguments: argparse.Namespace) -> dict[str, object]:
    """What an experiment was told beside seeds and files to write."""
    common = ("command", "paper", "experiment", "experiment_home", "run", "seeds", "out", "json")
    told = {name: value for name, value in vars(arguments).items() if name not in common}
    told = {name: str(value) if isinstance(value, Path) else value for name, value in told.items()}
    return {name: value for name, value in told.items() if isinstance(value, str | int | float | list | None)}
