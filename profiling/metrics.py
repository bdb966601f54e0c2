"""One form for everything that is measured: a named number with its unit, printed as a table, written as JSON."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from dense_vs.files import write_json
from dense_vs.view.provenance import provenance
from dense_vs.view.tables import table

RATIO_UNITS = ("x", "1")


@dataclass(frozen=True)
class Metric:
    """One measured figure.

    Attributes:
        name: what it is, the same in every run.
        value: the figure.
        unit: ``"ms"``, ``"fps"``, ``"px"``; ``"x"`` and ``"1"`` are ratios, which ``--gate`` compares.
        better: which way is better.
        tolerance: share of the value that two runs on one quiet machine may differ by.
    """

    name: str
    value: float
    unit: str
    better: Literal["higher", "lower"]
    tolerance: float = 0.1

    def holds(self, was: float, share: float | None = None) -> bool:
        """Whether it is no worse than it was by more than a share of that, its tolerance unless given.

        A figure that is no number does not.
        """
        margin = (self.tolerance if share is None else share) * abs(was)
        return self.value >= was - margin if self.better == "higher" else self.value <= was + margin


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    """Give a command the options ``--json FILE`` and ``--gate FILE``."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the metrics here")
    parser.add_argument(
        "--gate",
        type=Path,
        metavar="FILE",
        help="exit with 1 where a figure is worse than in this earlier result by more than its tolerance: ratios, and "
        "with some commands also times and rates, where the machine is of the same kind",
    )


def report(metrics: Sequence[Metric], arguments: argparse.Namespace, **beside: Any) -> int:
    """Print the metrics, write them where ``--json`` says with what they were made by and on, hold them to ``--gate``.

    Args:
        metrics: the figures.
        arguments: of the command.
        beside: what else the file is to hold.

    Returns:
        the exit code: 1 where the gate is not passed.
    """
    rows = [[m.name, f"{m.value:.4g}", m.unit, m.better] for m in metrics]
    print("\n" + table(("metric", "value", "unit", "better"), rows))
    if arguments.json is not None:
        origin = provenance(arguments, leave_out=("json", "gate"))
        write_json(arguments.json, {**origin, **beside, "metrics": [asdict(metric) for metric in metrics]})
    if arguments.gate is None:
        return 0
    baseline = {metric["name"]: metric for metric in json.loads(arguments.gate.read_text())["metrics"]}
    worse = regressions(metrics, baseline)
    for line in worse:
        print(line, file=sys.stderr)
    return 1 if worse else 0


def regressions(metrics: Sequence[Metric], baseline: dict[str, dict[str, Any]]) -> list[str]:
    """Figures that got worse, a line each.

    Only ratios are compared: a time or a rate belongs to the machine that it was measured on.
    """
    compared = [metric for metric in metrics if metric.unit in RATIO_UNITS and metric.name in baseline]
    if not compared:
        return ["no ratio of this run is in the baseline; expected one measured by the same script and arguments"]
    lines = []
    for metric in compared:
        before = baseline[metric.name]["value"]
        if not metric.holds(before):
            lines.append(f"{metric.name}: {metric.value:.4g}, was {before:.4g}, tolerance {metric.tolerance:.0%}")
    return lines
