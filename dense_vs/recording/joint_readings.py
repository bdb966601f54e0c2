"""Names and readings of the joints of a recording that is being written."""

from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_names, check_number, shown
from dense_vs.errors import DenseVSError

LONGEST_NAME = 256  # characters of a joint's name


def recorded_names(value: Any) -> tuple[str, ...]:
    """Names of joints that come back from a file as they are.

    Raises:
        DenseVSError: no sequence of names, or one that is empty, there twice, longer than 256 characters, or with
            characters that no file can hold.
    """
    names = check_names("joint names", value)
    for name in names:
        if not 0 < len(name) <= LONGEST_NAME or "\0" in name:
            raise DenseVSError(
                f"joint name {shown(name)} cannot be stored; expected 1 to {LONGEST_NAME} characters, none of them null"
            )
        recorded_text("joint name", name)
    if len(set(names)) != len(names):
        twice = next(name for number, name in enumerate(names) if name in names[:number])
        raise DenseVSError(f"joint name {shown(twice)} is there twice; expected each joint a name of its own")
    return names


def recorded_text(name: str, value: Any) -> str:
    """A text that a file can hold.

    Raises:
        DenseVSError: no text, or half of a surrogate pair in it.
    """
    try:
        if isinstance(value, str) and value.encode():
            return value
    except UnicodeEncodeError:
        pass
    raise DenseVSError(f"{name} is {shown(value)}; expected text that UTF-8 has")


class JointReadings:
    """Readings in the order of their stamps.

    Args:
        names: N joints.

    Attributes:
        times: of the readings [s], rising.
        positions: of each, ``(N,)``.
    """

    def __init__(self, names: tuple[str, ...]):
        self._count = len(names)
        self.times: list[float] = []
        self.positions: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self.times)

    def add(self, positions: np.ndarray, time: float) -> None:
        """Add a reading; one that is not newer than the last is the same reading again.

        Raises:
            DenseVSError: not N finite numbers, or a stamp that is none; the reading is left out.
        """
        q = number_array(positions, "joint positions", (self._count,))
        time = check_number("joint time stamp", time)
        if not self.times or time > self.times[-1]:
            self.times.append(time)
            self.positions.append(q)
