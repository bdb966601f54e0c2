"""Values that nobody should pass, and valid ones gone wrong: what the fuzz puts in place of good arguments."""

import datetime
import decimal
import fractions
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np


class Rude:
    """An object that refuses whatever it is asked."""

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise OSError("no array")

    def __float__(self) -> float:
        raise ZeroDivisionError("no number")

    def __repr__(self) -> str:
        return "<rude>"


# No number, whatever an argument means: to be refused wherever a number is expected.
NONSENSE: list[Callable[[], Any]] = [
    lambda: "x",
    lambda: "1",
    lambda: b"1",
    lambda: 1j,
    lambda: np.array([1j, 2.0]),
    lambda: np.array(["1", "2"]),
    lambda: np.array([b"1"]),
    lambda: np.array(["2020-01-01"], dtype="datetime64[D]"),
    lambda: np.datetime64("2020-01-01"),
    lambda: np.timedelta64(3, "s"),
    lambda: datetime.datetime(2020, 1, 1),
    lambda: {"a": 1},
    lambda: {1, 2},
    object,
    Rude,
    lambda: [[1.0, 2.0], [3.0]],
    lambda: [None, 1.0],
    lambda: np.array([object()], dtype=object),
    lambda: lambda: 1,
    lambda: Path("x"),
    lambda: ["a", "b"],
]
# Numbers, but seldom good ones.
ODD: list[Callable[[], Any]] = [
    lambda: None,
    lambda: 0,
    lambda: -1,
    lambda: 1,
    lambda: 2,
    lambda: 1.5,
    lambda: -0.0,
    lambda: True,
    lambda: False,
    lambda: np.nan,
    lambda: np.inf,
    lambda: -np.inf,
    lambda: 2**31,
    lambda: 2**63,
    lambda: 2**64,
    lambda: -(2**64),
    lambda: 10**400,
    lambda: 1e-300,
    lambda: 1e30,
    lambda: 1e300,
    lambda: np.float32(3e38),
    lambda: np.int64(2),
    lambda: np.uint8(3),
    lambda: np.float16(1.0),
    lambda: decimal.Decimal(1),
    lambda: fractions.Fraction(1, 2),
    lambda: np.longdouble("1e400"),
    lambda: [],
    lambda: (),
    lambda: "",
    lambda: [1.0],
    lambda: [[1.0, 2.0]],
    lambda: [10**400],
    lambda: np.zeros(0),
    lambda: np.zeros((0, 3)),
    lambda: np.zeros((1, 1, 1, 1, 1, 1)),
    lambda: np.float64(1.0).reshape(1),
    lambda: np.ones((2, 2), dtype=bool),
]
WORDS: list[Callable[[], Any]] = [
    lambda: "",
    lambda: "x",
    lambda: "a" * 5000,
    lambda: "\x00",
    lambda: "../..",
    lambda: "\ud800",
    lambda: b"x",
    lambda: None,
    lambda: 3,
    lambda: ["x"],
    object,
]


def instead_of(value: Any, random: np.random.Generator) -> tuple[Any, bool]:
    """A hostile value in place of a good one, and whether it is nonsense there: then it must not be accepted."""
    if isinstance(value, str):
        return _pick(WORDS, random), False
    numeric = isinstance(value, (bool, int, float, np.ndarray, np.generic, list, tuple)) and not _holds_text(value)
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and random.random() < 0.7:
        return spoiled(value, random)
    if random.random() < 0.45:
        return _pick(NONSENSE, random), numeric
    return _pick(ODD, random), False


def spoiled(good: np.ndarray, random: np.random.Generator) -> tuple[Any, bool]:
    """A good array with something wrong: a value, its shape or its type."""
    choice = int(random.integers(16))
    if choice < 5 and good.size:
        array = good.astype(np.float64 if good.dtype.kind != "f" else good.dtype)
        bad = [np.nan, np.inf, -np.inf, 3e38, -3e38, 1e30, 1e-40][int(random.integers(7))]
        flat = array.reshape(-1)
        flat[random.integers(good.size, size=max(1, int(random.integers(1, 4)) ** 3 % good.size + 1))] = bad
        return array, False
    if choice == 5:
        return np.full_like(good, 3e38 if good.dtype.kind == "f" else 200), False
    if choice == 6:
        return good.astype(complex) + 1j, True
    if choice == 7:
        return good.astype(str), True
    if choice == 8:
        return good.astype(object), True
    if choice == 9:
        return good[..., None], False
    if choice == 10:
        return good[:0], False
    if choice == 11:
        return np.swapaxes(good, 0, -1) if good.ndim > 1 else good[:-1], False
    if choice == 12:
        return good[::-1], False
    if choice == 13:
        return good.astype([np.float64, np.float16, np.int64, np.int8, np.uint16, bool][int(random.integers(6))]), False
    if choice == 14:
        return np.ma.masked_array(good, mask=np.zeros(good.shape, bool)), False
    return good.tolist(), False


def _holds_text(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and any(isinstance(one, (str, Path)) for one in value)


def _pick(pool: list[Callable[[], Any]], random: np.random.Generator) -> Any:
    return pool[int(random.integers(len(pool)))]()
