"""Matplotlib figures that are drawn straight into files: no window, no state shared between figures."""

import os
from typing import Any

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write


def new_figure(width: float, height: float) -> Any:
    """An empty ``matplotlib.figure.Figure`` of ``width`` x ``height`` inches that keeps its parts apart by itself.

    Raises:
        DenseVSError: Matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DenseVSError("plots need Matplotlib, which is not installed; pip install 'dense-vs[viz]'") from error
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Any, path: str | os.PathLike[str], dots_per_inch: int = 110) -> None:
    """Write a figure as PNG; a write that fails leaves what was at ``path``."""
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=dots_per_inch)
