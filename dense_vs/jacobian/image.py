"""A dense image Jacobian as the public API accepts it, on the device that needs it."""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.arrays import _host_or_gpu
from dense_vs.errors import DenseVSError


def array_shape(value: Any) -> tuple[int, ...]:
    """Shape of an array of numbers, with the axes of a Warp array's vectors or matrices; empty for what is no array."""
    shape = tuple(getattr(value, "shape", ()))
    return (*shape, *getattr(getattr(value, "dtype", None), "_shape_", ())) if isinstance(value, wp.array) else shape


def jacobian_image(value: Any, shape: tuple[int, int, int], joints: int, device: wp.Device) -> Any:
    """J as a ``(worlds, H, W)`` Warp array of (2, N) matrices on ``device``; no copy where it lies there already.

    Args:
        value: float32 ``(worlds, H, W, 2, N)``, or without the first axis for one world; values may be NaN.
        shape: expected (worlds, H, W).
        joints: N.
        device: where it is needed.

    Raises:
        DenseVSError: another shape or dtype.
    """
    full = (*shape, 2, joints)
    accepted = (full, full[1:]) if shape[0] == 1 else (full,)
    expected = f"a float32 array of shape {accepted[-1]}"
    array = _host_or_gpu(value, "jacobian", expected)
    got = array_shape(array)
    dtype = array.dtype
    name = dtype.name if isinstance(array, np.ndarray) else getattr(dtype, "_wp_scalar_type_", dtype).__name__
    if got not in accepted or name != "float32":
        raise DenseVSError(f"jacobian has shape {got} and dtype {name}; expected {expected}")
    matrix = wp.types.matrix((2, joints), wp.float32)
    if isinstance(array, np.ndarray):
        contiguous = np.ascontiguousarray(array).reshape(full)
        if device.is_cpu:
            image: Any = wp.array(ptr=contiguous.ctypes.data, dtype=matrix, shape=shape, device=device)
            image._source = contiguous  # the view does not own the memory
            return image
        return wp.array(contiguous, dtype=matrix, device=device)
    contiguous = array.contiguous()
    image = wp.array(ptr=contiguous.ptr, dtype=matrix, shape=shape, device=contiguous.device)
    image._source = contiguous
    return image if image.device == device else image.to(device)
