"""Arguments that are single values: numbers, whole numbers, choices and flags, checked and converted in one place."""

import math
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np

from dense_vs.errors import DenseVSError

Kind = TypeVar("Kind")
LONGEST_SHOWN = 300  # characters of a value in an error


def check_number(
    name: str,
    value: Any,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
) -> float:
    """A finite number within bounds as a float; ``above`` and ``below`` are left out themselves.

    Raises:
        DenseVSError: not a number (a bool is none), not finite, or out of bounds.
    """
    # A span of time is an integer to NumPy.
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, (bool, np.timedelta64))
    fits = (
        number
        and _finite(value)
        and (above is None or value > above)
        and (least is None or value >= least)
        and (below is None or value < below)
        and (most is None or value <= most)
    )
    if not fits:
        raise DenseVSError(f"{name} is {shown(value)}; expected a finite number{_bounds(above, least, below, most)}")
    return float(value)


def check_whole(name: str, value: Any, *, least: int | None = None, most: int | None = None) -> int:
    """A whole number within bounds as an int.

    Raises:
        DenseVSError: not an int of Python or NumPy (a bool is none), or out of bounds.
    """
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, (bool, np.timedelta64))
    if not whole or (least is not None and value < least) or (most is not None and value > most):
        raise DenseVSError(f"{name} is {shown(value)}; expected a whole number{_bounds(None, least, None, most)}")
    return int(value)


def check_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """One of a few names.

    Raises:
        DenseVSError: another value; the names are listed.
    """
    valid = tuple(choices)
    if not isinstance(value, str) or value not in valid:
        raise DenseVSError(f"{name} is {shown(value)}; expected one of {', '.join(valid)}")
    return value


def check_flag(name: str, value: Any) -> bool:
    """True or False.

    Raises:
        DenseVSError: anything else, 0, 1 and strings among it.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise DenseVSError(f"{name} is {shown(value)}; expected True or False")
    return bool(value)


def check_seed(value: Any) -> int:
    """A seed: a whole number of at least 0, and of at most 2^64 - 1.

    Raises:
        DenseVSError: anything else.
    """
    return check_whole("seed", value, least=0, most=(1 << 64) - 1)


def check_pair(name: str, value: Any, *, least: int, most: int) -> tuple[int, int]:
    """Two whole numbers, as a height and a width, each within bounds.

    Raises:
        DenseVSError: anything else.
    """
    if not is_list(value) or len(value) != 2:
        raise DenseVSError(f"{name} is {shown(value)}; expected two whole numbers")
    first, second = value
    return check_whole(f"{name}[0]", first, least=least, most=most), check_whole(
        f"{name}[1]", second, least=least, most=most
    )


def check_names(name: str, value: Any) -> tuple[str, ...]:
    """Several texts.

    Raises:
        DenseVSError: one text alone, or anything else.
    """
    try:
        names = () if isinstance(value, (str, bytes)) else tuple(value)
    except Exception:  # it cannot be gone through, as an array of no dimension, or its own code fails
        names = ()
    if not names or not all(isinstance(one, str) for one in names):
        raise DenseVSError(f"{name} is {shown(value)}; expected a sequence of names")
    return names


def check_flags(name: str, value: Any, count: int) -> np.ndarray:
    """Several flags, bool ``(count,)``.

    Raises:
        DenseVSError: another number of them, or anything else: a text is true to NumPy, and one flag is all.
    """
    try:
        flags = np.asarray(value)
    except Exception:  # a ragged list, or the value's own code
        flags = np.zeros(0)
    if flags.dtype != bool or flags.shape != (count,) or np.ma.is_masked(value):
        raise DenseVSError(f"{name} is {shown(value)}; expected True or False for each of {count}")
    return flags


def check_kind(name: str, value: Any, kind: type[Kind]) -> Kind:
    """A value of a class.

    Raises:
        DenseVSError: one of another class.
    """
    if not isinstance(value, kind):
        raise DenseVSError(f"{name} is {shown(value)}; expected a {kind.__name__}")
    return value


def check_options(name: str, value: Any, kind: type[Kind]) -> Kind:
    """Options of a class, its defaults for None.

    Raises:
        DenseVSError: a value of another class.
    """
    return kind() if value is None else check_kind(name, value, kind)


def check_methods(name: str, value: Any, *methods: str) -> None:
    """An object of any class with some methods, as an interface names them.

    Raises:
        DenseVSError: it lacks one of them.
    """
    missing = [method for method in methods if not _has(value, method)]
    if missing:
        raise DenseVSError(
            f"{name} is a {type(value).__name__} without {', '.join(missing)}; expected methods {', '.join(methods)}"
        )


def check_function(name: str, value: Any) -> None:
    """A function, or None.

    Raises:
        DenseVSError: anything else.
    """
    if value is not None and not callable(value):
        raise DenseVSError(f"{name} is {shown(value)}; expected a function, or None")


def is_list(value: Any) -> bool:
    """Whether a value is a list, a tuple or an array that has a length."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def shown(value: Any) -> str:
    """What a value looks like, as far as an error has room for it."""
    try:
        text = repr(value)
    except Exception:  # the value's own code, or an int of more digits than Python writes
        return f"a {type(value).__name__}"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _has(value: Any, method: str) -> bool:
    try:
        return callable(getattr(value, method, None))
    except Exception:  # the value's own code
        return False


def _finite(value: Any) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:  # an int that no float can hold
        return False


def _bounds(above: float | None, least: float | None, below: float | None, most: float | None) -> str:
    low = f" above {above:g}" if above is not None else f" of at least {least:g}" if least is not None else ""
    high = f"below {below:g}" if below is not None else f"at most {most:g}" if most is not None else ""
    if low and high:
        return f"{low} and {high}"
    return low or (f" {high}" if high else "")
