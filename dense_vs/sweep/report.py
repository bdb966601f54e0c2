"""What a sweep shows at its end: a table of figures over seeds, a plot of them, and what failed."""

import math
import re
import textwrap
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from dense_vs.errors import DenseVSError
from dense_vs.sweep.figures import Figure
from dense_vs.sweep.task import Outcome
from dense_vs.view.canvas import new_figure, save_figure
from dense_vs.view.tables import table

_PANELS = 12  # figures drawn; more do not fit a picture
_COLUMNS = 3


def figures_table(figures: Sequence[Figure]) -> str:
    """A table a group: how many runs found a figure, its median, least and largest."""
    parts = []
    for group in dict.fromkeys(figure.group for figure in figures):
        rows = []
        for figure in figures:
            if figure.group == group:
                least, middle, largest = figure.spread()
                found = sum(not math.isnan(value) for value in figure.values)
                numbers = [f"{value:.4g}" for value in (middle, least, largest)]
                rows.append([figure.name, f"{found} of {len(figure.values)}", *numbers])
        parts.append(f"{group}\n{table(['figure', 'runs', 'median', 'least', 'largest'], rows)}")
    return "\n\n".join(parts)


def draw_figures(folder: Path, figures: Sequence[Figure]) -> list[Path]:
    """A picture for each command: a panel for each figure, groups side by side, a dot a seed, a line at the median.

    Returns:
        the files, named after the commands.

    Raises:
        DenseVSError: Matplotlib is not installed, or a file cannot be written.
    """
    by_command: dict[str, list[Figure]] = {}
    for figure in figures:
        command = "-".join(takewhile(lambda word: not word.startswith("-"), figure.group.split()))
        by_command.setdefault(re.sub(r"[^\w.-]+", "_", command)[:80], []).append(figure)
    files = [folder / f"{command}.png" for command in by_command]
    for file, of_command in zip(files, by_command.values(), strict=True):
        _draw(file, of_command)
    return files


def _draw(path: Path, figures: Sequence[Figure]) -> None:
    names = list(dict.fromkeys(figure.name for figure in figures))[:_PANELS]
    groups = list(dict.fromkeys(figure.group for figure in figures))
    columns = min(len(names), _COLUMNS)
    lines = -(-len(names) // columns)
    drawing = new_figure(4.5 * columns, 2.8 * lines + 0.16 * len(groups))
    for number, name in enumerate(names):
        axes = drawing.add_subplot(lines, columns, number + 1)
        for figure in figures:
            if figure.name == name:
                at = groups.index(figure.group)
                axes.plot([at + 1] * len(figure.values), figure.values, ".", color="tab:blue", alpha=0.7)
                axes.hlines(figure.spread()[1], at + 0.75, at + 1.25, color="tab:orange")
        axes.set_title(textwrap.fill(name, 48), fontsize=9)
        axes.set_xticks(range(1, len(groups) + 1))
        axes.set_xlim(0.5, len(groups) + 0.5)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.grid(axis="y", alpha=0.3)
    said = "\n".join(f"{number}: {textwrap.shorten(group, 140)}" for number, group in enumerate(groups, start=1))
    drawing.supxlabel(said, fontsize=8, ha="left", x=0.02)
    save_figure(drawing, path)


def raise_failures(outcomes: list[Outcome]) -> None:
    """List the runs that failed, with their reasons and logs.

    Raises:
        DenseVSError: there are some.
    """
    failed = [outcome for outcome in outcomes if outcome.failure]
    if failed:
        rows = [[" ".join(one.task.arguments), one.failure, one.log or "-"] for one in failed]
        print(table(["failed", "reason", "log"], rows))
        raise DenseVSError(f"{len(failed)} of {len(outcomes)} runs failed; the same command runs those again")
