"""Labels that motion and appearance agree on, with outlines where the image has its edges (beyond the paper).

Flow bleeds over outlines and says little on plain surfaces; an object in the hand moves as the hand does. So each
pixel's log-odds are a sum: of motion, log(EQUAL E_e / E_u) with its sign turned, and of its color, see
:mod:`dense_vs.body.appearance`. Color speaks against a pixel anywhere; it speaks for one only where motion says
nothing or near pixels that both are sure of, as somebody who passes by may wear the robot's colors. The sum is smoothed
along the image's edges, and what is connected counts as the body where motion says so on average.
"""

from typing import Any

import cv2
import numpy as np

from dense_vs.body.appearance import Appearance
from dense_vs.body.guided_filter import guided_filter

# Found on recordings of a humanoid (episodes 5, 10, 20, 37), two simulated arms of plain surfaces and two walkers.
EQUAL = 0.3  # share of unexplained motion that speaks neither for nor against the body
LEAST_JACOBIAN = 20.0  # px/rad in standard units: joints that move a pixel less do not speak for it
UNKNOWN = -1.5  # log-odds of motion where nothing moves
MOST = 3.0  # log-odds of motion either way, and of a color against
MOST_FOR = 1.5  # log-odds of a color for the body
REACH = 20  # px that color carries the body on over
SURE = 1.4  # log-odds from which a pixel's color is learned
RADIUS, FLATNESS = 4, 1e-3  # of the smoothing
LEAST_PIXELS = 60  # of a connected part


class RefinedLabels:
    """Labels of one camera's images, of one size."""

    def __init__(self):
        self._appearance = Appearance()
        self._image = np.zeros((2, 2), np.uint8)
        self._odds = self._motion = np.full((2, 2), UNKNOWN, np.float32)
        self._own: np.ndarray | None = None

    def observe(self, image: np.ndarray, unexplained: np.ndarray, moved: np.ndarray) -> None:
        """Take a frame.

        Args:
            image: RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``.
            unexplained: share of the motion's energy ``(H, W)``, NaN where nothing is known.
            moved: whether the joints move a pixel by :data:`LEAST_JACOBIAN`, bool ``(H, W)``.
        """
        known = np.isfinite(unexplained)
        share = np.where(known, np.maximum(unexplained, 1e-3), 1.0)
        motion = np.clip(np.log(EQUAL / share), -MOST, MOST)
        motion = np.where(known, motion, UNKNOWN)
        motion = np.where(moved, motion, np.minimum(motion, UNKNOWN)).astype(np.float32)
        bins = self._appearance.color_bins(image)
        color = np.clip(self._appearance.log_odds(bins), -MOST, MOST_FOR)
        sure = ((motion + color > 1.0) & (motion > 0.3)).astype(np.uint8)
        near = cv2.dilate(sure, np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)) > 0
        color = np.where(near | ~known, color, np.minimum(color, 0.0))
        odds = motion + color
        around = cv2.blur(odds, (5, 5))
        own = (around > SURE) & (motion > 0.5)
        if own.sum() >= LEAST_PIXELS:  # before the robot moves nothing is known to be other
            self._appearance.learn(bins, own, (around < -SURE) & (motion <= -0.5))
        self._image, self._odds, self._motion, self._own = image, odds, motion, None

    def own(self) -> np.ndarray:
        """Whether each pixel of the last image is the robot's own body, bool ``(H, W)``."""
        if self._own is None:
            likely = guided_filter(self._image, self._odds, RADIUS, FLATNESS) > 0
            self._own = _moving_parts(likely, self._motion)
        return self._own


def _moving_parts(likely: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Those connected parts of a mask ``(H, W)`` whose mean log-odds of motion are above 0."""
    part: Any
    count, part, sizes, _ = cv2.connectedComponentsWithStats(likely.astype(np.uint8), connectivity=4)
    pixels = sizes[:, cv2.CC_STAT_AREA]
    total = np.bincount(part.ravel(), np.clip(motion, -2.0, 2.0).ravel(), count)
    kept = (total > 0) & (pixels >= LEAST_PIXELS)
    kept[0] = False  # what is not likely
    return kept[part]
