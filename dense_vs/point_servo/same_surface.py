"""Which pixels move as a point does: those whose J is like its own, as they belong to the same part of the body.

J is smooth, so beside an outline it is like the body's on what is not the body. Labels leave that out, or the body of a
model that is known: half a patch of something that stands in front holds the other half back.
"""

from typing import Any

import numpy as np

from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import FramePipeline

SAME_SURFACE = 0.5  # relative difference in J below which two pixels count as one surface
LEAST_OWN = 0.15  # of a patch, that has to be labeled as the robot's own


def unlikeness(estimator: DenseJacobian, point: Any) -> np.ndarray | None:
    """``(H, W)`` difference of every J from the point's, relative to the point's; None where J is 0."""
    own = estimator.at(point)[0]
    size = np.linalg.norm(own)
    if size == 0:
        return None
    return np.linalg.norm(estimator.to_numpy() - own, axis=(2, 3)) / size


def same_surface(estimator: DenseJacobian, point: Any) -> np.ndarray | None:
    """Bool ``(H, W)``: pixels that move as the point ``(2,)`` [px] does; None where J says nothing there yet."""
    unlike = unlikeness(estimator, point)
    return None if unlike is None else unlike <= SAME_SURFACE


def patch_weights(pipeline: FramePipeline, point: np.ndarray, window: int) -> np.ndarray | None:
    """The same without what is labeled as not the robot's own, where the labels know the body around the point.

    Args:
        pipeline: whose J and labels are asked.
        point: ``(2,)`` [px].
        window: side of the patch [px].
    """
    same = same_surface(pipeline.estimator, point)
    if same is None or pipeline.body is None:
        return same
    return own_part(same, pipeline.labels(), point, window)


def own_part(same: np.ndarray, own: np.ndarray, point: np.ndarray, window: int) -> np.ndarray:
    """Pixels ``(H, W)`` that move as a point does and are the robot's own, where enough about it are known to be.

    Args:
        same: of :func:`same_surface`.
        own: bool ``(H, W)``, the robot's own as far as is known.
        point: ``(2,)`` [px].
        window: side of the patch about it [px].
    """
    x, y = np.clip(np.rint(point), 0, (same.shape[1] - 1, same.shape[0] - 1)).astype(int)
    half = window // 2
    patch = np.s_[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
    both = same & own
    return both if both[patch].sum() >= LEAST_OWN * window**2 else same
