"""A call with good arguments, and small images and joints to make them of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

H, W, N = 24, 32, 3


@dataclass
class Target:
    """A call with good arguments.

    Attributes:
        name: for the report.
        call: takes them by keyword.
        good: the arguments by name, made anew for every case.
        may_be_nan: whether its result may hold values that are not finite.
        weight: how often it is drawn, against 1 of the others.
        state: of the object that is called, from its arguments under ``"self"``.
        kept: arguments that are not spoiled.
    """

    name: str
    call: Callable[..., Any]
    good: Callable[[], dict[str, Any]]
    may_be_nan: bool = False
    weight: float = 1.0
    state: Callable[[Any], Any] | None = None
    kept: tuple[str, ...] = ("self",)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def flow() -> np.ndarray:
    return rng().normal(size=(H, W, 2)).astype(np.float32)


def gray(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, (H, W)).astype(np.uint8)


def rgb() -> np.ndarray:
    return np.repeat(gray()[..., None], 3, axis=2)


def mask() -> np.ndarray:
    mask = np.zeros((H, W), dtype=bool)
    mask[6:16, 8:20] = True
    return mask


def dq() -> np.ndarray:
    return np.array([0.01, -0.02, 0.015])
