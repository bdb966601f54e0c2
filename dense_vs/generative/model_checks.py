"""What :class:`GenerativeModel` checks of its arguments, and what it says where its numerics find nothing to go on."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError


@contextmanager
def undetermined() -> Iterator[None]:
    """Say so where a stage of the learning finds nothing to go on with, wherever its numerics stop."""
    try:
        yield
    except DenseVSError:
        raise
    except (cv2.error, np.linalg.LinAlgError, ArithmeticError, ValueError, IndexError) as error:
        raise DenseVSError(f"the observations do not determine a model, as far as was looked: {error}") from error


def postures_array(value: Any, name: str, each: tuple[int, ...]) -> np.ndarray:
    """Finite numbers ``(T, *each)``; one of them counts as T = 1.

    Raises:
        DenseVSError: anything else.
    """
    shown = f"finite numbers of shape (T, {', '.join(map(str, each))})"
    array = number_array(value, name, expected=shown)
    if array.shape == each:
        array = array[None]
    if array.shape[1:] != each or array.ndim != 1 + len(each):
        raise DenseVSError(f"{name} have shape {array.shape}; expected {shown}")
    return array


def check_sigma(value: Any, name: str, count: int) -> None:
    """None, a number above 0, or ``count`` of them."""
    if value is None:
        return
    if count == 1:
        check_number(name, value, above=0.0)
        return
    try:
        numbers = list(value)
    except TypeError:
        numbers = []
    if len(numbers) != count:
        raise DenseVSError(f"{name} is {value!r}; expected {count} numbers above 0, or None")
    for place, number in enumerate(numbers):
        check_number(f"{name}[{place}]", number, above=0.0)
