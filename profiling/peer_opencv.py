"""The dense Kalman filter with OpenCV's ``remap`` for the prediction (14) and NumPy for the update (9) to (11).

A plane of J at a time: ``remap`` of one channel interpolates exactly, of eight it rounds positions to 1/32 px,
and the update is fastest on planes. OpenCV uses all cores.
"""

import cv2
import numpy as np
from filter_case import FilterNoises
from peer_numpy import PlaneFilter


class OpencvFilter(PlaneFilter):
    """The filter with OpenCV and NumPy."""

    def __init__(self, height: int, width: int, joints: int, noises: FilterNoises):
        super().__init__(height, width, joints, noises)
        self._rows, self._columns = np.indices((height, width), dtype=np.float32)
        self._x, self._y = np.empty_like(self._columns), np.empty_like(self._rows)

    def update(self, flow: np.ndarray, dq: np.ndarray) -> None:
        """One frame."""
        u = self.predict_flow(self.planes, dq)
        np.subtract(self._columns, u[0], out=self._x)
        np.subtract(self._rows, u[1], out=self._y)
        height, width = flow.shape[:2]
        sources, targets = (planes.reshape(-1, height, width) for planes in (self.planes, self.moved))
        for source, target in zip(sources, targets, strict=True):
            cv2.remap(source, self._x, self._y, cv2.INTER_LINEAR, dst=target, borderMode=cv2.BORDER_REPLICATE)
        self.correct(flow, dq)
