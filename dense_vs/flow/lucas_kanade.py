"""Dense flow by Lucas and Kanade's equations in Gaussian windows, from coarse to fine (Lucas and Kanade, 1981).

At every pixel the step d minimizes, over a window w around it,

    sum w (W - I - g . d)^2 + lambda |d|^2

with I the present image, W the previous one warped by the flow so far, and g the mean gradient of the two. Plain
surfaces have few gradients, so the first windows are wide: what little texture there is speaks for all of them. The
last step narrows the window and is held to the one before by a larger lambda, so that only where there is texture
neighbors may differ. Images are taken relative to their local mean, so that exposure and flicker cancel.

Beside dense inverse search J gets better from it on plain arms with seams and edges, where wide windows bridge what is
plain; where there is texture all over, search is sharper at outlines.
"""

from typing import Any

import cv2
import numpy as np

PRESMOOTHING = 0.8  # px, standard deviation
LOCAL_MEAN = 17  # px, side of the square that an image is taken relative to
COARSEST_SIDE = 60  # px, about: the shorter side of the coarsest level
MAX_STEP = 2.0  # px, of one solution
WIDE, WIDE_WEIGHT = 5.0, 0.1  # window [px, standard deviation] and lambda [gray levels^2 / px^2] of every level
NARROW, NARROW_WEIGHT = 2.5, 10.0  # of the last step
_DERIVATIVE = np.array([[1, -8, 0, 8, -1]], dtype=np.float32) / 12


class LucasKanade:
    """Flow between two images; what depends on their size alone is kept from one call to the next."""

    def __init__(self):
        self._grids: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}

    def __call__(self, previous: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Flow (H, W, 2) float32 [px] of uint8 images (H, W), stored at the pixels of the present one."""
        before, now = [_relative(previous)], [_relative(present)]
        levels = max(0, round(np.log2(min(present.shape) / COARSEST_SIDE)))
        for _ in range(levels):
            before.append(cv2.pyrDown(before[-1]))
            now.append(cv2.pyrDown(now[-1]))
        flow: Any = np.zeros((*now[-1].shape, 2), dtype=np.float32)
        slopes = _gradient(now[-1])
        for level in range(levels, -1, -1):
            height, width = now[level].shape
            if flow.shape[:2] != (height, width):
                before_height, before_width = flow.shape[:2]
                scale = np.array([width / before_width, height / before_height], dtype=np.float32)
                flow = cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR) * scale
                slopes = _gradient(now[level])
            flow += self._step(before[level], now[level], slopes, flow, WIDE, WIDE_WEIGHT)
        flow += self._step(before[0], now[0], slopes, flow, NARROW, NARROW_WEIGHT)
        return flow

    def _step(
        self,
        before: np.ndarray,
        now: np.ndarray,
        slopes: tuple[np.ndarray, np.ndarray],
        flow: np.ndarray,
        window: float,
        weight: float,
    ) -> np.ndarray:
        """What the flow changes by."""
        x, y = self._grid(*now.shape)
        warped = cv2.remap(
            before, x - flow[..., 0], y - flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        gx, gy = (0.5 * (a + b) for a, b in zip(_gradient(warped), slopes, strict=True))
        change = warped - now
        xx, xy, yy = (cv2.GaussianBlur(a, (0, 0), window) for a in (gx * gx, gx * gy, gy * gy))
        bx, by = (cv2.GaussianBlur(a, (0, 0), window) for a in (gx * change, gy * change))
        xx += np.float32(weight)
        yy += np.float32(weight)
        determinant = xx * yy - xy * xy  # at least weight^2, but for rounding
        np.maximum(determinant, np.float32(0.5 * weight**2), out=determinant)
        step = np.stack([(yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant], axis=-1)
        return np.clip(step, -MAX_STEP, MAX_STEP, out=step)

    def _grid(self, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        if (height, width) not in self._grids:
            y, x = np.mgrid[:height, :width].astype(np.float32)
            self._grids[height, width] = x, y
        return self._grids[height, width]


def _relative(image: np.ndarray) -> np.ndarray:
    """A smoothed image less its local mean, float32."""
    levels = image.astype(np.float32)
    levels -= cv2.blur(levels, (LOCAL_MEAN, LOCAL_MEAN))
    return cv2.GaussianBlur(levels, (0, 0), PRESMOOTHING)


def _gradient(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope along x and along y [gray levels / px]."""
    return cv2.filter2D(image, -1, _DERIVATIVE), cv2.filter2D(image, -1, _DERIVATIVE.T)
