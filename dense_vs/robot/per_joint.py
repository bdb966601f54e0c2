"""Bounds of joints, one for all or one for each, and the stamps that come with their readings."""

from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import shown
from dense_vs.errors import DenseVSError


def per_joint(name: str, value: Any, joints: int, *, above: float = 0.0) -> np.ndarray:
    """A bound of each joint, float64 ``(joints,)``, from one number or one for each.

    Raises:
        DenseVSError: not such numbers, or one that is not finite or not above ``above``.
    """
    expected = "a finite number above 0, or one for each joint"
    bounds = number_array(value, name, finite=False, expected=expected)
    if bounds.shape not in ((), (joints,)) or not (np.isfinite(bounds).all() and (bounds > above).all()):
        raise DenseVSError(f"{name} is {shown(value)}; expected {expected}, of which there are {joints}")
    return np.broadcast_to(bounds, (joints,)).copy()


def stamp_of(name: str, value: Any) -> float:
    """A time stamp [s], which may be no finite number: a robot's clock may say anything.

    Raises:
        DenseVSError: no number.
    """
    return value if isinstance(value, float) else float(number_array(value, name, (), finite=False))
