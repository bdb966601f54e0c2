"""Images as a camera gives them: what is none is refused before anything is done with it."""

from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError


def check_gray(image: Any, name: str = "image") -> np.ndarray:
    """A gray image, uint8 ``(H, W)``, as it is; of a masked array the array.

    Raises:
        DenseVSError: anything else, or no pixel.
    """
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2 or not image.size:
        raise DenseVSError(f"{name} {_kind(image)}; expected uint8 of shape (H, W)")
    return np.asarray(image)


def check_rgb(image: Any, name: str = "image", *, least: int = 1) -> np.ndarray:
    """An RGB image, uint8 ``(H, W, 3)`` of at least so many pixels a side, as it is.

    Raises:
        DenseVSError: anything else.
    """
    fits = isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    if not fits or min(image.shape[:2]) < least:
        size = f", at least {least} x {least}" if least > 1 else ""
        raise DenseVSError(f"{name} {_kind(image)}; expected uint8 of shape (H, W, 3){size}")
    return np.asarray(image)


def _kind(image: Any) -> str:
    if isinstance(image, np.ndarray):
        return f"has shape {image.shape} and dtype {image.dtype}"
    return f"is a {type(image).__name__}"
