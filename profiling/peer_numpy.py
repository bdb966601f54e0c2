"""The dense Kalman filter in NumPy: fancy-index bilinear prediction (14) and the diagonal update (9) to (11).

J is stored as planes, (2, N, H, W): NumPy's inner loops then run over pixels, which makes the update ten times as
fast as with the joints innermost. All arrays are float32, the big ones allocated once.
"""

import numpy as np
from filter_case import FilterNoises


class PlaneFilter:
    """State and update (9) to (11) on planes; what the NumPy and OpenCV peers share."""

    def __init__(self, height: int, width: int, joints: int, noises: FilterNoises):
        self.noises = noises
        self.planes = np.zeros((2, joints, height, width), dtype=np.float32)
        self.variance_planes = np.full((joints, height, width), noises.initial_variance, dtype=np.float32)
        self.moved = np.empty_like(self.planes)
        self.predicted = np.empty((2, height, width), dtype=np.float32)
        self._scratch = np.empty_like(self.planes)
        self._projected = np.empty_like(self.variance_planes)
        self._denominator = np.empty((height, width), dtype=np.float32)
        self._error = np.empty((2, height, width), dtype=np.float32)
        self._flow = np.empty_like(self._error)

    @property
    def jacobian(self) -> np.ndarray:
        """J, ``(H, W, 2, N)``."""
        return self.planes.transpose(2, 3, 0, 1)

    @property
    def variance(self) -> np.ndarray:
        """P, ``(H, W, N)``."""
        return self.variance_planes.transpose(1, 2, 0)

    def predict_flow(self, planes: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """J dq, planes ``(2, H, W)``."""
        return np.einsum("n,cnhw->chw", dq, planes, out=self.predicted)

    def correct(self, flow: np.ndarray, dq: np.ndarray) -> None:
        """(9) to (11) on ``moved``, which becomes the state."""
        noises, variance = self.noises, self.variance_planes
        variance += np.float32(noises.process_noise * float(dq @ dq))
        np.minimum(variance, np.float32(noises.max_variance), out=variance)
        np.multiply(variance, dq[:, None, None], out=self._projected)
        np.einsum("n,nhw->hw", dq, self._projected, out=self._denominator)
        self._denominator += np.float32(noises.measurement_noise)
        self._flow[:] = flow.transpose(2, 0, 1)
        np.subtract(self._flow, self.predict_flow(self.moved, dq), out=self._error)
        self._error /= self._denominator
        np.multiply(self._error[:, None], self._projected, out=self._scratch)
        self.moved += self._scratch
        np.square(self._projected, out=self._projected)
        self._projected /= self._denominator
        variance -= self._projected
        self.planes, self.moved = self.moved, self.planes


class NumpyPlanesFilter(PlaneFilter):
    """The filter with NumPy alone."""

    def __init__(self, height: int, width: int, joints: int, noises: FilterNoises):
        super().__init__(height, width, joints, noises)
        self._rows, self._columns = np.indices((height, width), dtype=np.float32)
        self._taps = np.empty((height, width), dtype=np.float32)

    def update(self, flow: np.ndarray, dq: np.ndarray) -> None:
        """One frame."""
        height, width = flow.shape[:2]
        u = self.predict_flow(self.planes, dq)
        x = np.clip(self._columns - u[0], 0, width - 1)
        y = np.clip(self._rows - u[1], 0, height - 1)
        left = np.minimum(x.astype(np.intp), width - 2)
        top = np.minimum(y.astype(np.intp), height - 2)
        ax = x - left.astype(np.float32)
        ay = y - top.astype(np.float32)
        first = top * width + left
        corners = (
            (first, (1 - ax) * (1 - ay)),
            (first + 1, ax * (1 - ay)),
            (first + width, (1 - ax) * ay),
            (first + width + 1, ax * ay),
        )
        sources = self.planes.reshape(-1, height * width)
        targets = self.moved.reshape(-1, height, width)
        targets.fill(0)
        for plane, source in enumerate(sources):
            for pixel, weight in corners:
                # The indices are inside already; "clip" spares NumPy a copy that "raise" makes.
                np.take(source, pixel, out=self._taps, mode="clip")
                self._taps *= weight
                targets[plane] += self._taps
        self.correct(flow, dq)
