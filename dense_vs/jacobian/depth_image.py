"""A depth image as the public API accepts it: meters, 0 or NaN where it is not known."""

from typing import Any

import numpy as np

from dense_vs.arrays import plain_array
from dense_vs.errors import DenseVSError

FARTHEST = 100.0  # m; a median beyond is no meters


def depth_image(value: Any, shape: tuple[int, ...], *, empty: bool = False) -> np.ndarray:
    """Depth along the optical axis, float32 of ``shape`` [m], 0 where it is not known.

    Args:
        value: floating point; 0, NaN and infinite where it is not known.
        shape: expected, (height, width) or (worlds, height, width).
        empty: whether an image without any depth is accepted, as of a camera that is covered for a moment.

    Raises:
        DenseVSError: another shape, whole numbers, which are in no unit of ours, depth below 0, a median beyond 100 m,
            or none at all.
    """
    expected = f"depth in meters, floating point of shape {shape}, 0 or NaN where it is not known"
    array = plain_array(value, "depth", expected)
    if array.shape != shape or array.dtype.kind != "f":
        counts = "; whole numbers are often millimeters: divide by 1000.0" if array.dtype.kind in "iu" else ""
        raise DenseVSError(f"depth has shape {array.shape} and dtype {array.dtype}; expected {expected}{counts}")
    with np.errstate(invalid="ignore", over="ignore"):
        image = array.astype(np.float32)
        known = np.isfinite(image) & (image != 0)
    if not known.any():
        if empty:
            return np.zeros(shape, np.float32)
        raise DenseVSError(f"depth has no pixel that is known, all are 0, NaN or infinite; expected {expected}")
    least, middle = float(image[known].min()), float(np.median(image[known]))
    if least < 0 or middle > FARTHEST:
        raise DenseVSError(
            f"depth has a median of {middle:g} and a least value of {least:g}; expected {expected}, at least 0 with a "
            f"median of at most {FARTHEST:g} m"
        )
    return np.where(known, image, np.float32(0))
