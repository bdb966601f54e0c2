"""One picture of an estimate from a recording: the motion explained, by time and by joint, the joints, and J."""

import os
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write


def write_report(path: str | os.PathLike[str], summary: dict[str, Any], done: Any) -> None:
    """Write ``report.png``.

    Args:
        path: of the PNG.
        summary: what ``summary.json`` holds.
        done: the :class:`~dense_vs.pipeline.RecordedEstimate` after its last frame.

    Raises:
        DenseVSError: Matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DenseVSError("plots need Matplotlib, which is not installed; pip install 'dense-vs[viz]'") from error
    figure = Figure(figsize=(12, 9), layout="constrained")
    FigureCanvasAgg(figure)
    (over_time, picture), (by_joint, joints) = figure.subplots(2, 2)
    figure.suptitle(
        f"{summary['format']}, episode {summary['episode']}, {summary['camera']}: explained motion "
        f"{summary['explained_motion']:.3f}, {summary['repeated_images']} of {summary['frames']} images repeated, "
        f"offset {summary['time_offset_s']:+.3f} s (confidence {summary['time_offset_confidence']:.2f})"
    )
    times, explained = done.explained.over_time()
    over_time.plot(times, explained, color="C0", linewidth=0.8)
    over_time.set(ylim=(-0.2, 1.05), xlabel="time [s]", ylabel="E", title="Share of the motion explained a frame ahead")
    over_time.grid(alpha=0.3)
    frame, step = done.last_frame, done.usual_step
    if frame is not None:
        picture.imshow(frame.image, cmap="gray")
        size = np.linalg.norm(np.nan_to_num(done.estimator.to_numpy()) * step, axis=(2, 3))
        shown = picture.imshow(size, cmap="magma", alpha=0.6)
        figure.colorbar(shown, ax=picture, label="px a frame")
    picture.set_title("Last image; motion that usual joint steps would cause")
    picture.axis("off")
    names = summary["joints"]
    rows = np.arange(len(names))
    by_joint.barh(rows, [summary["explained_motion_by_joint"][name] for name in names], color="C1")
    by_joint.set(yticks=rows, xlabel="part of E", title="What each joint explains")
    by_joint.set_yticklabels(names, fontsize="small")
    by_joint.invert_yaxis()
    log = done.episode.log
    low, high = log.positions.min(axis=0), log.positions.max(axis=0)
    shown_rows = np.linspace(0, len(log.times) - 1, min(len(log.times), 2000)).astype(int)
    for n, name in enumerate(names):
        range_ = high[n] - low[n]
        joints.plot(
            log.times[shown_rows],
            (log.positions[shown_rows, n] - low[n]) / (range_ or 1.0) - 1.2 * n,
            linewidth=0.8,
            label=f"{name} ({range_:.3g})",
        )
    joints.set(yticks=[], xlabel="time [s]", title="Joints, each over its own range")
    joints.legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    with atomic_write(path) as stream:
        figure.savefig(stream, format="png", dpi=100)
