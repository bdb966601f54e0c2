"""Arrays that the public API accepts, and how they reach the device.

NumPy and Warp arrays and anything with ``__array_interface__``, ``__cuda_array_interface__`` or
``__dlpack__`` are taken, without a copy where they already lie on the device.
"""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.checks import shown
from dense_vs.errors import DenseVSError
from dense_vs.kernels.views import seen_as


def host_or_gpu(value: Any, name: str, expected: str) -> Any:
    """The value as a NumPy array, or as a Warp array where it lies on a GPU."""
    if isinstance(value, wp.array):
        device: Any = value.device
        return value.numpy() if device.is_cpu else value
    if isinstance(value, np.ndarray):
        return _unmasked(value, name, expected)
    try:
        if hasattr(value, "__cuda_array_interface__"):
            return wp.array(value, copy=False)
        if hasattr(value, "__dlpack_device__") and value.__dlpack_device__()[0] != 1:  # not kDLCPU
            return wp.from_dlpack(value)
        if hasattr(value, "__dlpack__") and not hasattr(value, "__array__"):
            return np.from_dlpack(value)
        return np.asarray(value)
    except Exception as error:  # the array interfaces are the other library's, or the caller's own, code
        raise DenseVSError(f"{name} is a {type(value).__name__}; expected {expected} ({error})") from error


def vec2_image(value: Any, name: str, shape: tuple[int, int, int], device: wp.Device) -> Any:
    """A dense vector image as a ``(worlds, height, width)`` Warp array of vec2 on ``device``.

    Args:
        value: float32, ``(worlds, height, width, 2)``, or without the first axis for one world.
        name: what to call it in an error.
        shape: expected (worlds, height, width).
        device: where it is needed.

    Raises:
        DenseVSError: another shape or dtype.
    """
    full = (*shape, 2)
    accepted = (full, full[1:]) if shape[0] == 1 else (full,)
    expected = f"a float32 array of shape {accepted[-1]}"
    array = host_or_gpu(value, name, expected)
    if isinstance(array, np.ndarray):
        got, dtype_name = array.shape, array.dtype.name
    else:
        got = (*array.shape, *getattr(array.dtype, "_shape_", ()))
        dtype_name = getattr(array.dtype, "_wp_scalar_type_", array.dtype).__name__
    if got not in accepted or dtype_name != "float32":
        raise DenseVSError(f"{name} has shape {got} and dtype {dtype_name}; expected {expected}")
    if isinstance(array, np.ndarray):
        contiguous = np.ascontiguousarray(array).reshape(full)
        return wp.array(contiguous, dtype=wp.vec2, device=device, copy=not device.is_cpu)
    image = seen_as(array.contiguous(), wp.vec2, shape)
    return image if image.device == device else image.to(device)


def real_vector(
    value: Any, name: str, shape: tuple[int, ...], dtype: Any = np.float64, *, copy: bool = True
) -> np.ndarray:
    """Finite numbers as a NumPy array of ``shape`` and ``dtype``; -1 in ``shape`` takes any length.

    Without ``copy`` it may be the array given, for who only reads it and at once: to copy a large one takes a while.

    Raises:
        DenseVSError: another shape, not floating point, or a value that is not finite in ``dtype``.
    """
    if type(value) is np.ndarray and value.dtype == dtype and _fits(value.shape, shape) and np.isfinite(value).all():
        return value.copy() if copy else value
    sizes = str(tuple("any" if n < 0 else n for n in shape)).replace("'", "")
    expected = f"finite floating-point numbers of shape {sizes}"
    array = host_or_gpu(value, name, expected)
    if isinstance(array, wp.array):
        array = array.numpy()
    if not _fits(array.shape, shape) or array.dtype.kind != "f":
        raise DenseVSError(f"{name} has shape {array.shape} and dtype {array.dtype}; expected {expected}")
    with np.errstate(over="ignore"):
        numbers = array.astype(dtype, copy=copy)
    if not np.isfinite(numbers).all():
        raise DenseVSError(f"{name} is {shown(array.tolist())}; expected {expected}")
    return numbers


def share_image(share: Any, size: tuple[int, int]) -> np.ndarray:
    """Shares ``(H, W)`` float32 from 0 to 1, of an image size; it may be the array given.

    Raises:
        DenseVSError: another shape, or a share that is not from 0 to 1.
    """
    weight = real_vector(share, "share", size, np.float32, copy=False)
    if weight.size and (weight.min() < 0 or weight.max() > 1):
        raise DenseVSError(f"share is from {weight.min()} to {weight.max()}; expected 0 to 1")
    return weight


def number_array(
    value: Any, name: str, shape: tuple[int, ...] | None = None, *, finite: bool = True, expected: str = ""
) -> np.ndarray:
    """Numbers as float64; lists and whole numbers are welcome, which :func:`real_vector` refuses.

    Args:
        value: anything that NumPy makes an array of; what is returned is a copy.
        name: what to call it in an error.
        shape: expected, -1 takes any length; any shape unless given.
        finite: whether NaN and infinities are refused.
        expected: what the error says was expected; made of the above unless given.

    Raises:
        DenseVSError: another shape, a value that is not finite, or no numbers: bools, complex numbers, texts, bytes and
            dates are none, and neither is a ragged list.
    """
    plain = type(value) is np.ndarray and value.dtype == np.float64 and shape is not None and _fits(value.shape, shape)
    if plain and (not finite or np.isfinite(value).all()):
        return value.copy()
    sizes = "" if shape is None else f" of shape {tuple('any' if n < 0 else n for n in shape)}".replace("'", "")
    expected = expected or f"{'finite ' if finite else ''}numbers{sizes}"
    array = plain_array(value, name, expected)
    if array.dtype.kind not in "iuf" or isinstance(value, bytearray):  # bytes are no numbers either
        raise DenseVSError(f"{name} is {shown(value)} of dtype {array.dtype}; expected {expected}")
    if shape is not None and not _fits(array.shape, shape):
        raise DenseVSError(f"{name} has shape {array.shape}; expected {expected}")
    try:
        with np.errstate(over="ignore"):
            numbers = array.astype(np.float64)  # long doubles may leave its range
    except MemoryError as error:  # a view may seem larger than what it shows
        raise DenseVSError(f"{name} has shape {array.shape}; expected {expected} that memory has room for") from error
    if finite and not np.isfinite(numbers).all():
        raise DenseVSError(f"{name} is {shown(numbers.tolist())}; expected {expected}")
    return numbers


def plain_array(value: Any, name: str, expected: str) -> np.ndarray:
    """The value as a NumPy array of whatever it holds, on the host.

    Raises:
        DenseVSError: it cannot be read as an array, as a ragged list.
    """
    try:
        if isinstance(value, np.ndarray):
            return _unmasked(value, name, expected)
        return np.asarray(value.numpy() if isinstance(value, wp.array) else value)
    except DenseVSError:
        raise
    except Exception as error:  # an object of the caller's may raise whatever it likes when it is read
        raise DenseVSError(f"{name} is a {type(value).__name__}; expected {expected} ({error})") from error


def _unmasked(array: np.ndarray, name: str, expected: str) -> np.ndarray:
    """The array without what a subclass does in another way; what a mask hides is no number."""
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        raise DenseVSError(f"{name} has masked values; expected {expected}")
    return np.asarray(array)


def _fits(got: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    if got == shape:  # as nearly always
        return True
    return len(got) == len(shape) and all(want in (-1, found) for want, found in zip(shape, got, strict=True))


def points_array(value: Any, name: str) -> np.ndarray:
    """Image points as float64 ``(K, 2)``; lists and whole numbers are welcome, one point counts as K = 1.

    Raises:
        DenseVSError: another shape, or a coordinate that is not finite.
    """
    expected = "finite image points of shape (K, 2)"
    array = number_array(value, name, finite=False, expected=expected)
    if array.shape == (2,):
        array = array[None]
    if array.ndim != 2 or array.shape[1] != 2 or not np.isfinite(array).all():
        raise DenseVSError(f"{name} has shape {array.shape} and values {shown(array.tolist())}; expected {expected}")
    return array


def point_array(value: Any, name: str) -> np.ndarray:
    """One image point as float64 ``(2,)``; otherwise as :func:`points_array`."""
    points = points_array(value, name)
    if len(points) != 1:
        raise DenseVSError(f"{name} has shape {points.shape}; expected one image point of shape (2,)")
    return points[0]


def quantile(values: np.ndarray, share: float) -> float:
    """As ``np.quantile`` of some finite numbers ``(K,)``, K > 0, at a share from 0 to 1; in a fifth of its time."""
    place = share * (values.size - 1)
    low = int(place)
    high = min(low + 1, values.size - 1)
    ordered = np.partition(values, (low, high))
    first, second = float(ordered[low]), float(ordered[high])
    return first + (place - low) * (second - first)


def middle(values: np.ndarray, axis: int = 0) -> np.ndarray:
    """As ``np.median`` of finite numbers along an axis with at least one, in a third of its time where they are few."""
    ordered, count = np.sort(values, axis=axis), values.shape[axis]
    return 0.5 * (ordered.take((count - 1) // 2, axis) + ordered.take(count // 2, axis))
