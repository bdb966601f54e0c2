"""Which pixels move as a point does: those whose J is like its own, as they belong to the same part of the body."""

from typing import Any

import numpy as np

from dense_vs.jacobian.estimator import DenseJacobian

SAME_SURFACE = 0.5  # relative difference in J below which two pixels count as one surface


def same_surface(estimator: DenseJacobian, point: Any) -> np.ndarray | None:
    """Bool ``(H, W)``: pixels that move as the point ``(2,)`` [px] does; None where J says nothing there yet."""
    own = estimator.at(point)[0]
    size = np.linalg.norm(own)
    if size == 0:
        return None
    return np.linalg.norm(estimator.to_numpy() - own, axis=(2, 3)) <= SAME_SURFACE * size
