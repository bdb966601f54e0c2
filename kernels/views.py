"""The same device memory seen as elements of another type and shape."""

from typing import Any

import numpy as np
import warp as wp


def seen_as(array: Any, dtype: Any, shape: tuple[int, ...], *, strides: tuple[int, ...] | None = None) -> Any:
    """A Warp array on the memory of another array, which it keeps alive.

    Args:
        array: of Warp, or of NumPy for one on the CPU; contiguous, unless ``strides`` says how its memory is walked.
        dtype, shape: of the view.
        strides: of the view [bytes]; those of a contiguous array unless given.
    """
    host = isinstance(array, np.ndarray)
    pointer, device = (array.ctypes.data, "cpu") if host else (array.ptr, array.device)
    view: Any = wp.array(ptr=pointer, dtype=dtype, shape=shape, strides=strides, device=device)
    view._source = array  # a Warp array made from a pointer does not own the memory
    return view


def write(array: Any, values: np.ndarray) -> None:
    """Numbers of the same shape into a Warp array; on a CPU in a third of the time that ``assign`` takes."""
    if array.device.is_cpu:
        array.numpy()[...] = values
    else:
        array.assign(values)
