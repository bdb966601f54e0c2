"""Figures of finished tasks, gathered by what they share."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from dense_vs.errors import DenseVSError
from dense_vs.files import read_json
from dense_vs.sweep.run_task import FIGURES_FILE, OUT_FOLDER, result_folder
from dense_vs.sweep.task import Task

SUMMARY_FILE = "summary.json"


@dataclass(frozen=True)
class Figure:
    """One figure of all seeds of a group.

    Attributes:
        group: what the runs share.
        name: of the figure, with its unit.
        values: by seed, in the order of the tasks; NaN where a run did not find it.
        seeds: of the values.
    """

    group: str
    name: str
    values: tuple[float, ...]
    seeds: tuple[int | None, ...]

    def spread(self) -> tuple[float, float, float]:
        """Least, median and largest of those found; NaN where none was."""
        found = [value for value in self.values if not math.isnan(value)]
        return (min(found), median(found), max(found)) if found else (math.nan, math.nan, math.nan)


def figures_of(folder: Path, task: Task) -> dict[str, float]:
    """Figures of one finished task by name: rows of an experiment, else the plain numbers of its summary."""
    place = result_folder(folder, task)
    if (rows := _read(place / FIGURES_FILE)) is not None and isinstance(rows.get("rows"), list):
        return {_named(row): _number(row.get("ours")) for row in rows["rows"] if isinstance(row, dict)}
    summary = _read(place / OUT_FOLDER / SUMMARY_FILE) or {}
    numbers = {name: value for name, value in summary.items() if not isinstance(value, bool)}
    figures = {name: _number(value) for name, value in numbers.items() if isinstance(value, int | float)}
    listed = summary.get("targets")
    targets = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
    if targets:
        figures["targets reached"] = float(sum(bool(one.get("reached")) for one in targets))
        errors = [_number(one.get("true_error_px")) for one in targets]
        figures["worst true error [px]"] = max(errors, default=math.nan)
    return figures


def gathered(folder: Path, tasks: Iterable[Task]) -> list[Figure]:
    """Every figure of every group, in the order of the tasks."""
    found: dict[str, list[tuple[int | None, dict[str, float]]]] = {}
    for task in tasks:
        found.setdefault(task.group, []).append((task.seed, figures_of(folder, task)))
    result = []
    for group, runs in found.items():
        names = dict.fromkeys(name for _, figures in runs for name in figures)
        seeds = tuple(seed for seed, _ in runs)
        result += [
            Figure(group, name, tuple(figures.get(name, math.nan) for _, figures in runs), seeds) for name in names
        ]
    return result


def _named(row: dict[str, Any]) -> str:
    unit = row.get("unit")
    return f"{row.get('name')} [{unit}]" if unit else str(row.get("name"))


def _number(value: Any) -> float:
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:  # a whole number that no float holds
        return math.nan


def _read(path: Path) -> dict[str, Any] | None:
    try:
        content = read_json(path)
    except DenseVSError:
        return None
    return content if isinstance(content, dict) else None
