"""Pictures of self-recognition: labels over the camera image, as DIJE's Fig. 4, and the stages before them, Fig. 2."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write
from dense_vs.view.panels import GREEN, RED, WHITE, label, tile

if TYPE_CHECKING:
    from dense_vs.sims.papers.dije.leak_run import LeakRun

YELLOW = (255, 220, 60)


def overlay(rgb: np.ndarray, own: np.ndarray, robot: np.ndarray, walker: np.ndarray, text: str) -> np.ndarray:
    """Labels in red over an image ``(H, W, 3)``, with the true outlines of robot (green) and walker (yellow)."""
    painted = rgb.copy()
    painted[own] = (0.45 * rgb[own] + 0.55 * np.array(RED)).astype(np.uint8)
    for mask, colour in ((walker, YELLOW), (robot, GREEN)):
        outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(painted, outlines, -1, colour, 1)
    return label(painted, text)


def states_image(states: np.ndarray, text: str) -> np.ndarray:
    """Own pixels red, others grey, unknown ones black."""
    colours = np.array([(0, 0, 0), (120, 120, 120), RED], dtype=np.uint8)
    return label(colours[states.astype(int) + 1], text)


def clusters_image(index: np.ndarray, own: np.ndarray, text: str) -> np.ndarray:
    """Each cluster in its own shade, as Fig. 2: of red where it is the body's, of blue elsewhere; -1 black.

    Args:
        index: ``(H, W)``.
        own: ``(H, W)`` bool.
        text: label.
    """
    count = max(int(index.max()) + 1, 1)
    shade = np.where(index >= 0, 90 + 165 * (index.astype(int) + 1) // count, 0).astype(np.uint8)
    image = np.zeros((*index.shape, 3), np.uint8)
    image[..., 0] = np.where(own, shade, 0)
    image[..., 2] = np.where(own, 0, shade)
    return label(image, text)


def share_image(share: np.ndarray, text: str) -> np.ndarray:
    """A share from 0 (white) to 1 (black); what is not a number dark blue."""
    known = np.isfinite(share)
    grey = (255 * (1 - np.clip(np.where(known, share, 1), 0, 1))).astype(np.uint8)
    image = np.repeat(grey[..., None], 3, axis=2)
    image[~known] = (0, 0, 70)
    return label(image, text)


def draw_leak(run: "LeakRun", methods: Mapping[str, str], path: Path) -> None:
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
    legend = label(np.zeros_like(view.rgb), "red: labelled own")
    for row, (text, colour) in enumerate((("true outline of the robot", GREEN), ("of the walker", YELLOW))):
        cv2.putText(legend, text, (6, 50 + 24 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
    note = "below: J moved for 100 frames, not corrected"
    cv2.putText(legend, note, (6, 110), cv2.FONT_HERSHEY_SIMPLEX, 0.42, WHITE, 1, cv2.LINE_AA)
    write_image(path, tile([*above, *below, legend], columns=3))


def plot_leak(runs: Sequence["LeakRun"], methods: Mapping[str, str], path: Path) -> None:
    """IoU and leaked pixels over time: a thin line a seed, their median thick."""
    figure, axes = _figure(2)
    for colour, (name, title) in zip(("tab:red", "tab:blue", "tab:orange"), methods.items(), strict=True):
        times = np.array(runs[0].labellers[name].times)
        for axis, part in zip(axes, ("iou", "leak_px"), strict=True):
            values = np.array([getattr(run.labellers[name], part) for run in runs])
            axis.plot(times, values.T, color=colour, lw=0.6, alpha=0.4)
            axis.plot(times, np.median(values, axis=0), color=colour, lw=1.8, label=title)
    axes[0].set(
        ylabel="IoU with the robot's pixels",
        ylim=(0, 1),
        title="Labels of the robot's own body: a thin line a seed, their median thick",
    )
    axes[1].set(ylabel="walker's pixels labelled own [px]", xlabel="time [s]")
    handles, titles = axes[0].get_legend_handles_labels()
    figure.legend(handles, titles, loc="outside lower center", ncols=len(titles), fontsize="small")
    for axis in axes:
        axis.grid(alpha=0.3)
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=110)


def write_image(path: Path, image: np.ndarray) -> None:
    """Write an RGB image as PNG, twice as large."""
    large = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    done, data = cv2.imencode(".png", cv2.cvtColor(large, cv2.COLOR_RGB2BGR))
    assert done
    with atomic_write(path) as stream:
        stream.write(data.tobytes())


def _figure(rows: int) -> tuple[Any, Any]:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DenseVSError("plots need Matplotlib, which is not installed; pip install 'dense-vs[viz]'") from error
    figure = Figure(figsize=(9, 6), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 1, sharex=True)
