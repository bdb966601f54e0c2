"""Fig. 4 of DIJE: labels where a walker passes, with J corrected and with J only moved, and their errors over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from dense_vs.sims.papers.dije.label_pictures import YELLOW, overlay, write_image
from dense_vs.sims.papers.dije.leak_record import LeakRun
from dense_vs.view.canvas import new_figure, save_figure
from dense_vs.view.panels import GREEN, WHITE, label, tile


def draw_leak(run: LeakRun, methods: Mapping[str, str], path: Path) -> None:
    """Above, the labels where most of the walker is seen; below, where J has got to when it is only transported."""
    view, moved = run.shown, run.transport_view
    assert view is not None
    assert moved is not None
    above = [
        overlay(view.rgb, run.shown_labels[name], view.robot, view.walker, f"{view.time:.1f} s, {title}")
        for name, title in methods.items()
    ]
    below = [
        overlay(moved.rgb, carried, moved.robot, moved.walker, f"{moved.time:.1f} s, only transported, {name}")
        for name, carried in run.transport_labels.items()
    ]
    legend = label(np.zeros_like(view.rgb), "red: labeled own")
    for row, (text, color) in enumerate((("true outline of the robot", GREEN), ("of the walker", YELLOW))):
        cv2.putText(legend, text, (6, 50 + 24 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)
    note = "below: J moved for 100 frames, not corrected"
    cv2.putText(legend, note, (6, 110), cv2.FONT_HERSHEY_SIMPLEX, 0.42, WHITE, 1, cv2.LINE_AA)
    write_image(path, tile([*above, *below, legend], columns=3))


def plot_leak(runs: Sequence[LeakRun], methods: Mapping[str, str], path: Path) -> None:
    """IoU and leaked pixels over time: a thin line a seed, their median thick."""
    figure = new_figure(9, 6)
    axes = figure.subplots(2, 1, sharex=True)
    for color, (name, title) in zip(("tab:red", "tab:blue", "tab:orange"), methods.items(), strict=True):
        times = np.array(runs[0].labelers[name].times)
        for axis, part in zip(axes, ("iou", "leak_px"), strict=True):
            values = np.array([getattr(run.labelers[name], part) for run in runs])
            axis.plot(times, values.T, color=color, lw=0.6, alpha=0.4)
            axis.plot(times, np.median(values, axis=0), color=color, lw=1.8, label=title)
    axes[0].set(
        ylabel="IoU with the robot's pixels",
        ylim=(0, 1),
        title="Labels of the robot's own body: a thin line a seed, their median thick",
    )
    axes[1].set(ylabel="walker's pixels labeled own [px]", xlabel="time [s]")
    handles, titles = axes[0].get_legend_handles_labels()
    figure.legend(handles, titles, loc="outside lower center", ncols=len(titles), fontsize="small")
    for axis in axes:
        axis.grid(alpha=0.3)
    save_figure(figure, path)
