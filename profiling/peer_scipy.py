"""The dense Kalman filter with ``scipy.interpolate.interpn``, which the paper names, and NumPy for the update.

``interpn`` takes all columns of J in one call, joints innermost, which is faster than a call a plane.
It computes in float64 whatever it is given.
"""

import numpy as np
from filter_case import FilterNoises
from peer_numpy import PlaneFilter
from scipy.interpolate import interpn


class ScipyPlanesFilter(PlaneFilter):
    """The filter with SciPy's interpolation."""

    def __init__(self, height: int, width: int, joints: int, noises: FilterNoises):
        super().__init__(height, width, joints, noises)
        self._grid = np.arange(height, dtype=np.float32), np.arange(width, dtype=np.float32)
        self._pixels = np.moveaxis(np.indices((height, width), dtype=np.float32), 0, -1).copy()
        self._last = np.array([height - 1, width - 1], dtype=np.float32)
        self._places = np.empty_like(self._pixels)
        self._columns = np.empty((height, width, 2 * joints), dtype=np.float32)

    def update(self, flow: np.ndarray, dq: np.ndarray) -> None:
        """One frame."""
        height, width = flow.shape[:2]
        u = self.predict_flow(self.planes, dq)
        np.subtract(self._pixels, u[::-1].transpose(1, 2, 0), out=self._places)
        np.clip(self._places, 0, self._last, out=self._places)
        self._columns[:] = self.planes.reshape(-1, height, width).transpose(1, 2, 0)
        moved = interpn(self._grid, self._columns, self._places, method="linear")
        self.moved.reshape(-1, height, width)[:] = moved.transpose(2, 0, 1)
        self.correct(flow, dq)
