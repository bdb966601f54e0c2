"""Readings of the joints of a recording that is being written."""

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number


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
