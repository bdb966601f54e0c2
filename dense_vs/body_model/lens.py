"""A lens that bends straight lines, by one number: k1 of Brown's model, as a share of the image.

A webcam draws the corners of an image some pixels nearer to its middle than a pinhole would. Where features cross half
the image, that is more than what lines of joints are off by once they are adjusted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.kernels.body.surface_image import BORDER

STEPS = 6  # of Newton's method; three are enough for lenses up to 0.2 either way


@dataclass(frozen=True)
class Lens:
    """Places in the image with and without the lens's bend.

    Attributes:
        center: ``(2,)`` principal point [px].
        corner: distance of the image's corners from there [px].
        bend: share by which a corner is seen farther out than by a pinhole, below 0 for nearer (barrel).
    """

    center: np.ndarray
    corner: float
    bend: float = 0.0

    @classmethod
    def of_center(cls, center: np.ndarray, bend: float = 0.0) -> "Lens":
        """Of an image whose middle is the principal point ``(2,)`` [px]."""
        middle = np.array(center, dtype=np.float64)
        return cls(middle, max(float(np.linalg.norm(middle)), 1.0), bend)

    def bent(self, straight: np.ndarray) -> np.ndarray:
        """Where a pinhole's places ``(..., 2)`` [px] are seen."""
        return self.seen(straight - self.center)

    def seen(self, away: np.ndarray) -> np.ndarray:
        """Where is seen what a pinhole shows so far from the principal point, ``(..., 2)`` [px]."""
        return self.center + away * (1 + self.bend * np.minimum(self._squares(away), BORDER))

    def straight(self, seen: np.ndarray) -> np.ndarray:
        """Where a pinhole would see what is seen at places ``(..., 2)`` [px]; the inverse of :meth:`bent`."""
        away = np.asarray(seen, dtype=np.float64) - self.center
        radius = np.sqrt(self._squares(away))
        r, farthest = radius.copy(), np.sqrt(BORDER)
        for _ in range(STEPS):
            bent = self.bend * r * r
            r = r - (r + bent * r - radius) / np.maximum(1 + 3 * bent, 0.1)
            r = np.minimum(np.maximum(r, 0.0), farthest)
        beyond = radius > farthest * (1 + BORDER * self.bend)
        r = np.where(beyond, radius / (1 + BORDER * self.bend), r)
        return self.center + away * np.divide(r, radius, out=np.ones_like(r), where=radius > 0)

    def straightened(self, images: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        """Images ``(H, W)`` as a pinhole would show them; black where the lens shows nothing."""
        if self.bend == 0 or not len(images):
            return images
        height, width = images[0].shape
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        seen = self.bent(np.stack([x, y], axis=-1).astype(np.float64)).astype(np.float32)
        return [cv2.remap(image, seen[..., 0], seen[..., 1], cv2.INTER_LINEAR) for image in images]

    def slopes(self, straight: np.ndarray) -> np.ndarray:
        """Derivative of :meth:`bent` by the places, ``(..., 2, 2)``."""
        away = straight - self.center
        squares = self._squares(away)
        grows = (squares < BORDER)[..., None] * (2 * self.bend / self.corner**2)
        along = (1 + self.bend * np.minimum(squares, BORDER))[..., None] * np.eye(2)
        return along + grows * away[..., :, None] * away[..., None, :]

    def _squares(self, away: np.ndarray) -> np.ndarray:
        """Squared distance from the middle, 1 at a corner, ``(..., 1)``."""
        return np.einsum("...i,...i->...", away, away)[..., None] / self.corner**2
