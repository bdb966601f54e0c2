"""Plots of a reaching run: the point and its target over time, as DIJE Fig. 7, and J at the point."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from dense_vs.view.canvas import new_figure, save_figure

WIDTH = 10  # inches
KEY, LETTER = 0.6, 0.085  # inches, of a line and its surroundings in the legend, and of a letter


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
    times = np.array(trace.times)
    points, true_points, targets = (np.array(values) for values in (trace.points, trace.true_points, trace.targets))
    estimated, true = np.array(trace.estimated), np.array(trace.true)
    figure = new_figure(WIDTH, 11)
    axes = figure.subplots(4, 1, sharex=True)
    for row, name in enumerate("xy"):
        place, slope = axes[row], axes[2 + row]
        place.plot(times, targets[:, row], color="tab:green", drawstyle="steps-post", label="target")
        place.plot(times, points[:, row], color="tab:red", label="tracked point")
        place.plot(times, true_points[:, row], color="black", linestyle=":", label="true point")
        place.set_ylabel(f"{name} [px]")
        for n, joint in enumerate(joint_names):
            color_name = f"C{n}"
            slope.plot(times, estimated[:, row, n], color=color_name, label=joint)
            slope.plot(times, true[:, row, n], color=color_name, linestyle="--")
        slope.set_ylabel(f"d{name}/dq at the point [px/rad]")
    axes[0].set_title("Point and target")
    axes[2].set_title("J at the point: estimated (solid) and true (dashed)")
    axes[0].legend(loc="upper left", fontsize="small", ncols=3)
    lines = axes[2].get_lines()[::2]  # of each joint, estimated
    across = int((WIDTH - 1) // (KEY + LETTER * max(map(len, joint_names), default=0)))
    columns = min(max(1, across), max(1, len(joint_names)))
    figure.legend(lines, joint_names, loc="outside lower center", fontsize="small", ncols=columns)
    learned = np.flatnonzero(~np.isnan(points[:, 0]))
    for axis in axes:
        axis.grid(alpha=0.3)
        if learned.size:
            axis.axvspan(times[0], times[learned[0]], color="gray", alpha=0.15)
    if learned.size:
        axes[0].text(times[0], 0.03, " babbling", transform=axes[0].get_xaxis_transform(), color="gray")
    axes[-1].set_xlabel("time [s]")
    save_figure(figure, path)
