"""The dense Kalman filter as DIJE's equations read, in NumPy: J is (H, W, 2, N), joints innermost.

This is what one writes from the paper, with the ``interpn`` that it names, or with fancy indexing in its place. The
plane-wise versions beside it (``peer_scipy.py``, ``peer_numpy.py``) are faster.
"""

from abc import ABC, abstractmethod

import numpy as np
from filter_case import FilterNoises
from scipy.interpolate import interpn


class PlainFilter(ABC):
    """State, prediction (14) and update (9) to (11), float32 as the library's own."""

    def __init__(self, height: int, width: int, joints: int, noises: FilterNoises):
        self.noises = noises
        self.jacobian = np.zeros((height, width, 2, joints), dtype=np.float32)
        self.variance = np.full((height, width, joints), noises.initial_variance, dtype=np.float32)
        self._pixels = np.moveaxis(np.indices((height, width), dtype=np.float32), 0, -1)  # row, column
        self._last = np.array([height - 1, width - 1], dtype=np.float32)

    @abstractmethod
    def moved(self, places: np.ndarray) -> np.ndarray:
        """J at (row, column) ``places`` ``(H, W, 2)``."""

    def update(self, flow: np.ndarray, dq: np.ndarray) -> None:
        """One frame."""
        predicted = self.jacobian @ dq
        prior = self.moved(np.clip(self._pixels - predicted[..., ::-1], 0, self._last))
        variance = np.minimum(
            self.variance + np.float32(self.noises.process_noise * float(dq @ dq)), np.float32(self.noises.max_variance)
        )
        projected = variance * dq
        denominator = projected @ dq + np.float32(self.noises.measurement_noise)
        error = (flow - prior @ dq) / denominator[..., None]
        self.jacobian = prior + error[..., None] * projected[:, :, None, :]
        self.variance = variance - projected**2 / denominator[..., None]


class ScipyFilter(PlainFilter):
    """With SciPy's ``interpn``, which computes in float64 whatever it is given."""

    def moved(self, places: np.ndarray) -> np.ndarray:
        """J at ``places``."""
        height, width = places.shape[:2]
        return interpn((np.arange(height), np.arange(width)), self.jacobian, places).astype(np.float32)


class NumpyFilter(PlainFilter):
    """With four fancy-indexed reads."""

    def moved(self, places: np.ndarray) -> np.ndarray:
        """J at ``places``."""
        height, width = places.shape[:2]
        top, left = (np.minimum(places[..., i].astype(np.intp), (height, width)[i] - 2) for i in range(2))
        ay, ax = ((places[..., i] - start)[..., None, None] for i, start in enumerate((top, left)))
        upper = self.jacobian[top, left] * (1 - ax) + self.jacobian[top, left + 1] * ax
        lower = self.jacobian[top + 1, left] * (1 - ax) + self.jacobian[top + 1, left + 1] * ax
        return upper * (1 - ay) + lower * ay
