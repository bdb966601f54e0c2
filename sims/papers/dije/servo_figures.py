"""Pictures of a servo run as the paper's: paths over camera images (Fig. 6), places over time (Fig. 7 to 9), J."""

from pathlib import Path

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write
from dense_vs.sims.papers.dije.servo_run import ServoTask, TaskRun
from dense_vs.view.panels import RED, draw_point, label, tile, vectors_to_rgb

_SCALE = 2  # of the camera images


def draw_run(task: ServoTask, run: TaskRun, out: Path) -> None:
    """Write ``seedN_images.png``, ``seedN_time.png`` and ``seedN_jacobian.png``."""
    _write(out / f"seed{run.seed}_images.png", _images(run))
    _write(out / f"seed{run.seed}_jacobian.png", _jacobians(task, run))
    _over_time(task, run, out / f"seed{run.seed}_time.png")


def _images(run: TaskRun) -> np.ndarray:
    """The camera at the end of each reach, with the path of the point, as Fig. 6."""
    panels = []
    for number, reach in enumerate(run.reaches):
        image = cv2.resize(reach.image, None, fx=_SCALE, fy=_SCALE, interpolation=cv2.INTER_LINEAR)
        first, last = reach.path
        points = np.array(run.trace.points[first : last + 1]) * _SCALE + 0.5 * (_SCALE - 1)
        path = np.rint(points[np.isfinite(points).all(axis=1)]).astype(np.int32)[:, None]
        cv2.polylines(image, [path], False, (0, 0, 0), 4, cv2.LINE_AA)
        cv2.polylines(image, [path], False, RED, 2, cv2.LINE_AA)
        draw_point(image, np.array(reach.target) * _SCALE + 0.5, "target")
        draw_point(image, points[-1], "point")
        text = f"{number + 1}: {reach.point}, {reach.frames / 30:.1f} s, true error {reach.true_error_px:.2f} px"
        panels.append(label(image, text + ", lost" * reach.lost))
    return tile(panels, columns=min(2, len(panels)))


def _jacobians(task: ServoTask, run: TaskRun) -> np.ndarray:
    """Columns of J at the end: estimated above, true below."""
    assert run.estimated is not None
    assert run.true is not None
    assert run.mask is not None
    panels = []
    for name, jacobian in (("estimated", run.estimated), ("true", run.true)):
        for n, joint in enumerate(task.joints):
            scale = max(float(np.percentile(np.linalg.norm(run.true[run.mask][..., n], axis=1), 99)), 1.0)
            panels.append(label(vectors_to_rgb(jacobian[..., n], scale), f"{name}: {joint}"))
    return tile(panels, columns=len(task.joints))


def _over_time(task: ServoTask, run: TaskRun, path: Path) -> None:
    """Point and target over time, as Fig. 7 to 9, and the true distance between them."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DenseVSError("plots need Matplotlib, which is not installed; pip install 'dense-vs[viz]'") from error
    begin = run.reaches[0].path[0]
    times = np.array(run.trace.times[begin:])
    points, true, targets = (
        np.array(values[begin:]) for values in (run.trace.points, run.trace.true_points, run.trace.targets)
    )
    figure = Figure(figsize=(9, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 1, sharex=True)
    for column, name in enumerate(("horizontal", "vertical")):
        axes[column].plot(times, points[:, column], color="tab:red", label="p_self")
        axes[column].plot(times, true[:, column], color="black", ls=":", lw=1, label="true place of the point")
        axes[column].plot(times, targets[:, column], color="tab:green", drawstyle="steps-pre", label="p_target")
        axes[column].set_ylabel(f"{name} [px]")
    axes[2].plot(times, np.hypot(*(true - targets).T), color="black")
    axes[2].set(ylabel="true error [px]", xlabel="time [s]", yscale="log", ylim=(0.05, None))
    axes[2].axhline(task.close_px, color="grey", ls="--", lw=1)
    axes[0].legend(fontsize="small", ncols=3)
    axes[0].set_title(f"{task.robot}, seed {run.seed}: as {task.figure}; J was learnt for {times[0]:.0f} s before")
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
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=110)


def _write(path: Path, image: np.ndarray) -> None:
    _, png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    with atomic_write(path) as stream:
        stream.write(png.tobytes())
