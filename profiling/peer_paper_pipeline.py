"""The paper's whole frame with the libraries it names: OpenCV's Farneback, SciPy's ``interpn`` and ``vq``.

Gray, flow (window 15, 3 levels, 3 iterations), predict and update, the label of every pixel where asked for
(DIJE Algorithm 2, 5 clusters), point tracking DIJE (15) and servo command DIJE (17).
"""

import cv2
import numpy as np
from filter_case import FilterNoises
from peer_plain import ScipyFilter
from scipy.cluster.vq import vq

CLUSTERS = 5
GAIN = 0.2


class PaperPipeline:
    """The paper's loop for one robot, without its robot.

    Args:
        first_image: RGB uint8 ``(H, W, 3)``.
        joints: number of joints.
        point: that is servoed [px].
        target: of it [px].
        labels: whether every frame labels its pixels.
    """

    def __init__(self, first_image: np.ndarray, joints: int, point: np.ndarray, target: np.ndarray, *, labels: bool):
        height, width = first_image.shape[:2]
        self._gray = cv2.cvtColor(first_image, cv2.COLOR_RGB2GRAY)
        self._filter = ScipyFilter(height, width, joints, FilterNoises())
        # What k-means finds does not change what assigning pixels to it costs.
        self._centers = np.random.default_rng(0).normal(0, 50, (CLUSTERS, 2 * joints)).astype(np.float32)
        self._vectors = np.empty((height, width, 2 * joints), dtype=np.float32)
        self._point = np.array(point, dtype=np.float64)
        self._target = np.array(target, dtype=np.float64)
        self.labels = np.zeros((height, width), dtype=np.int32) if labels else None

    def frame(self, image: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """From an image and the joint step to it to the next command ``(N,)``."""
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        flow = np.empty((*gray.shape, 2), dtype=np.float32)
        cv2.calcOpticalFlowFarneback(gray, self._gray, flow, 0.5, 3, 15, 3, 5, 1.1, 0)
        np.negative(flow, out=flow)
        self._gray = gray
        self._filter.update(flow, dq)
        height, width = gray.shape
        if self.labels is not None:
            self._vectors[:] = self._filter.jacobian.reshape(height, width, -1)
            codes, _ = vq(self._vectors.reshape(height * width, -1), self._centers, check_finite=False)
            self.labels = codes.reshape(height, width)
        self._point = np.clip(self._point + self._at(flow), 0, (width - 1, height - 1))
        jacobian = self._at(self._filter.jacobian)
        return GAIN * np.linalg.pinv(jacobian) @ (self._target - self._point)

    def _at(self, image: np.ndarray) -> np.ndarray:
        """Bilinear value of an image at the point."""
        height, width = image.shape[:2]
        left, top = np.minimum(self._point.astype(int), (width - 2, height - 2))
        ax, ay = self._point - (left, top)
        upper = image[top, left] * (1 - ax) + image[top, left + 1] * ax
        lower = image[top + 1, left] * (1 - ax) + image[top + 1, left + 1] * ax
        return upper * (1 - ay) + lower * ay
