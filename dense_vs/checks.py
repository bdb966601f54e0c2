"""Arguments that are single values: numbers, whole numbers, choices and flags, checked and converted in one place."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError


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
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    fits = (
        number
        and _finite(value)
        and (above is None or value > above)
        and (least is None or value >= least)
        and (below is None or value < below)
        and (most is None or value <= most)
    )
    if not fits:
        raise DenseVSError(f"{name} is {value!r}; expected a finite number{_bounds(above, least, below, most)}")
    return float(value)


def check_whole(name: str, value: Any, *, least: int | None = None, most: int | None = None) -> int:
    """A whole number within bounds as an int.

    Raises:
        DenseVSError: not an int of Python or NumPy (a bool is none), or out of bounds.
    """
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or (least is not None and value < least) or (most is not None and value > most):
        raise DenseVSError(f"{name} is {value!r}; expected a whole number{_bounds(None, least, None, most)}")
    return int(value)


def check_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """One of a few names.

    Raises:
        DenseVSError: another value; the names are listed.
    """
    valid = tuple(choices)
    if not isinstance(value, str) or value not in valid:
        raise DenseVSError(f"{name} is {value!r}; expected one of {', '.join(valid)}")
    return value


def check_flag(name: str, value: Any) -> bool:
    """True or False.

    Raises:
        DenseVSError: anything else, 0, 1 and strings among it.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise DenseVSError(f"{name} is {value!r}; expected True or False")
    return bool(value)


def _finite(value: Any) -> bool:
    try:
        return bool(np.isfinite(float(value)))
    except OverflowError:  # an int that no float can hold
        return False


def _bounds(above: float | None, least: float | None, below: float | None, most: float | None) -> str:
    low = f" above {above:g}" if above is not None else f" of at least {least:g}" if least is not None else ""
    high = f"below {below:g}" if below is not None else f"at most {most:g}" if most is not None else ""
    if low and high:
        return f"{low} and {high}"
    return low or (f" {high}" if high else "")
