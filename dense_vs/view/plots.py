"""Plots of a reaching run: the point and its target over time, as DIJE Fig. 7, and J at the point."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write


def plot_reach(trace: Any, joint_names: Sequence[str], path: str | os.PathLike[str]) -> None:
    """Write a PNG of a trace.

    Args:
        trace: ``times``; ``points``, ``true_points`` and ``targets`` ``(T, 2)`` [px]; ``estimated`` and ``true``,
            J at the point ``(T, 2, N)`` [px/rad].
        joint_names: N labels.
        path: of the PNG.

    Raises:
        DenseVSError: Matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DenseVSError("plots need Matplotlib, which is not installed; pip install 'dense-vs[viz]'") from error
    times = np.array(trace.times)
    points, true_points, targets = (np.array(values) for values in (trace.points, trace.true_points, trace.targets))
    estimated, true = np.array(trace.estimated), np.array(trace.true)
    figure = Figure(figsize=(10, 11), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 1, sharex=True)
    for row, name in enumerate("xy"):
        place, slope = axes[row], axes[2 + row]
        place.plot(times, targets[:, row], color="tab:green", drawstyle="steps-post", label="target")
        place.plot(times, points[:, row], color="tab:red", label="tracked point")
        place.plot(times, true_points[:, row], color="black", linestyle=":", label="true point")
        place.set_ylabel(f"{name} [px]")
        for n, joint in enumerate(joint_names):
            colour = f"C{n}"
            slope.plot(times, estimated[:, row, n], color=colour, label=joint)
            slope.plot(times, true[:, row, n], color=colour, linestyle="--")
        slope.set_ylabel(f"d{name}/dq at the point [px/rad]")
    axes[0].set_title("Point and target")
    axes[2].set_title("J at the point: estimated (solid) and true (dashed)")
    for axis in (axes[0], axes[2]):
        axis.legend(loc="upper left", fontsize="small", ncols=max(3, len(joint_names)))
    learnt = np.flatnonzero(~np.isnan(points[:, 0]))
    for axis in axes:
        axis.grid(alpha=0.3)
        if learnt.size:
            axis.axvspan(times[0], times[learnt[0]], color="grey", alpha=0.15)
    if learnt.size:
        axes[0].text(times[0], 0.03, " babbling", transform=axes[0].get_xaxis_transform(), color="grey")
    axes[-1].set_xlabel("time [s]")
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=110)
