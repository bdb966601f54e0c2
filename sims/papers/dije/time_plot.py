"""Figs. 7 to 9 of DIJE: point and target over time, and the true distance between them."""

from pathlib import Path

import numpy as np

from dense_vs.sims.papers.dije.servo_record import ServoTask, TaskRun
from dense_vs.view.canvas import new_figure, save_figure


def plot_over_time(task: ServoTask, run: TaskRun, path: Path) -> None:
    """Point and target over time, as Fig. 7 to 9, and the true distance between them."""
    begin = run.reaches[0].path[0]
    times = np.array(run.trace.times[begin:])
    points, true, targets = (
        np.array(values[begin:]) for values in (run.trace.points, run.trace.true_points, run.trace.targets)
    )
    figure = new_figure(9, 7.5)
    axes = figure.subplots(3, 1, sharex=True)
    for column, name in enumerate(("horizontal", "vertical")):
        axes[column].plot(times, points[:, column], color="tab:red", label="p_self")
        axes[column].plot(times, true[:, column], color="black", ls=":", lw=1, label="true place of the point")
        axes[column].plot(times, targets[:, column], color="tab:green", drawstyle="steps-pre", label="p_target")
        axes[column].set_ylabel(f"{name} [px]")
    axes[2].plot(times, np.hypot(*(true - targets).T), color="black")
    axes[2].set(ylabel="true error [px]", xlabel="time [s]", yscale="log", ylim=(0.05, None))
    axes[2].axhline(task.close_px, color="gray", ls="--", lw=1)
    axes[0].legend(fontsize="small", ncols=3)
    axes[0].set_title(f"{task.robot}, seed {run.seed}: as {task.figure}; J was learned for {times[0]:.0f} s before")
    shown = None
    for reach in run.reaches:
        if shown not in (None, reach.point):
            at = run.trace.times[reach.path[0]]
            for axis in axes:
                axis.axvline(at, color="tab:blue", lw=1)
            axes[0].annotate(
                f" p_self is now {reach.point}", (at, 1), xycoords=("data", "axes fraction"), va="top", color="tab:blue"
            )
        shown = reach.point
    for axis in axes:
        axis.grid(alpha=0.3)
    save_figure(figure, path)
