"""Charts of the experiments: lines with the spread over seeds, the paper's values beside ours."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.files import atomic_write


def draw_lines(
    path: Path,
    series: Mapping[str, tuple[Sequence[float] | np.ndarray, np.ndarray]],
    *,
    title: str,
    x_label: str,
    y_label: str,
    paper: Mapping[str, tuple[Sequence[float], Sequence[float]]] | None = None,
    levels: Mapping[str, float] | None = None,
    logarithmic: bool = True,
) -> None:
    """Write a PNG.

    Args:
        path: of the PNG.
        series: label -> places (k,) and values (repetitions, k); the median is drawn, and a band of all values.
        title, x_label, y_label: texts.
        paper: label -> places and values that the paper printed.
        levels: label -> height of a dotted line.
        logarithmic: the scale of y.
    """
    figure, axes = _figure()
    for number, (label, (places, values)) in enumerate(series.items()):
        table = np.where(np.isfinite(values), values, np.nan)
        drawn = np.isfinite(table).any(axis=0)
        shown, table = np.asarray(list(places), dtype=float)[drawn], table[:, drawn]
        colour = f"C{number % 10}"
        axes.plot(shown, np.nanmedian(table, axis=0), marker="o", ms=3, color=colour, label=label)
        if len(table) > 1:
            low, high = np.nanmin(table, axis=0), np.nanmax(table, axis=0)
            axes.fill_between(shown, low, high, color=colour, alpha=0.15, lw=0)
    for number, (label, (places, values)) in enumerate((paper or {}).items()):
        marker = "xs^d*+"[number % 6]
        axes.plot(places, values, color="black", marker=marker, ls="--", lw=0.8, ms=5, label=label)
    for label, height in (levels or {}).items():
        axes.axhline(height, color="grey", ls=":", lw=1)
        axes.annotate(label, (0.01, height), xycoords=("axes fraction", "data"), ha="left", va="top", color="grey")
    if logarithmic:
        axes.set_yscale("log")
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    axes.grid(alpha=0.3, which="both" if logarithmic else "major")
    axes.legend(fontsize="small")
    save(figure, path)


def draw_points(
    path: Path, series: Mapping[str, tuple[np.ndarray, np.ndarray]], *, title: str, x_label: str, y_label: str
) -> None:
    """Write a PNG of points: label -> x (k,) and y (k,)."""
    figure, axes = _figure()
    for label, (x, y) in series.items():
        axes.plot(x, y, ls="", marker="o", ms=4, alpha=0.7, label=label)
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    save(figure, path)


def draw_bars(
    path: Path,
    labels: Sequence[str],
    series: Mapping[str, Sequence[float]],
    *,
    title: str,
    y_label: str,
    logarithmic: bool = True,
) -> None:
    """Write a PNG of groups of bars: a group a label, a bar a series."""
    figure, axes = _figure()
    width = 0.8 / len(series)
    for number, (label, values) in enumerate(series.items()):
        places = np.arange(len(labels)) + (number - (len(series) - 1) / 2) * width
        axes.bar(places, values, width, label=label, color="0.6" if label == "paper" else f"C{number}")
    if logarithmic:
        axes.set_yscale("log")
    axes.set_xticks(range(len(labels)), labels, rotation=20, ha="right", fontsize="small")
    axes.set(title=title, ylabel=y_label)
    axes.grid(alpha=0.3, axis="y")
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    save(figure, path)


def draw_images(path: Path, rows: Sequence[Sequence[np.ndarray]], titles: Sequence[str]) -> None:
    """Write a PNG of images (H, W, 3) in rows, a title a column."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.0 * len(titles), 2.0 * len(rows) + 0.3), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(rows), len(titles), squeeze=False)
    for row, images in zip(grid, rows, strict=True):
        for axes in row:
            axes.axis("off")
        for axes, image in zip(row, images, strict=False):
            axes.imshow(image)
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(title, fontsize="small")
    save(figure, path)


def close_up(images: Sequence[np.ndarray], pixels: np.ndarray) -> list[np.ndarray]:
    """Parts (280, 280, 3) of each camera's image (H, W, 3) about and above features (C, k, 2) [px]."""
    parts = []
    for image, seen in zip(images, pixels, strict=True):
        shown = seen[np.isfinite(seen[:, 0])]
        x, y = shown.mean(axis=0) if len(shown) else (image.shape[1] / 2, image.shape[0] / 2)
        left = int(np.clip(x - 140, 0, image.shape[1] - 280))
        top = int(np.clip(y - 200, 0, image.shape[0] - 280))
        parts.append(image[top : top + 280, left : left + 280])
    return parts


def save(figure: Any, path: Path) -> None:
    """Write a figure as PNG, whole or not at all."""
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=110)


def _figure() -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 5), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots()
