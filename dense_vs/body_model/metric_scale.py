"""A body's unit of length in meters, by depth images."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dense_vs.arrays import plain_array, real_vector
from dense_vs.errors import DenseVSError

LEAST_WITH_DEPTH = 50  # pixels of the body


def meters_by_unit(of_body: Sequence[np.ndarray], depths: Sequence[Any]) -> float:
    """Meters that are one unit of a body's, the median over pixels: noise and holes do little to it.

    Args:
        of_body: K images ``(H, W)`` of the body's depths in its unit, infinite off the body.
        depths: K images, each floating point ``(H, W)`` [m], 0 or NaN where depth is not known.

    Raises:
        DenseVSError: depth images of another size or whole numbers, or less than 50 pixels of the body with depth.
    """
    ratios = [np.zeros(0)]
    for there, depth in zip(of_body, depths, strict=True):
        image = plain_array(depth, "depth", f"floating-point numbers of shape {there.shape}")
        seen = real_vector(np.nan_to_num(image, posinf=0.0), "depth", there.shape)
        both = np.isfinite(there) & (seen > 0)
        ratios.append(seen[both] / there[both])
    found = np.concatenate(ratios)
    if len(found) < LEAST_WITH_DEPTH:
        raise DenseVSError(
            f"depth is known at {len(found)} pixels of the body; expected at least {LEAST_WITH_DEPTH} in depth "
            "images in meters, 0 or NaN where it is not known"
        )
    return float(np.median(found))
