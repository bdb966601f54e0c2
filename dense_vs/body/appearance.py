"""How the robot's own body looks, learned from the pixels that motion is sure of (beyond the paper).

Two running histograms of colors, of own and of other pixels, give each color's log-odds log(p(color | own) /
p(color | other)). Colors that both have in equal shares say nothing, so a body that looks like its surroundings is
labeled by motion alone. Chromaticity is stretched, as few surfaces are vivid. The memory is long: an object that
stood still before a hand took it is known as other while it moves with the hand.
"""

from typing import Any

import cv2
import numpy as np

BINS = 8  # for each of lightness and the two axes of chromaticity
VIVID = 3  # factor on chromaticity
MEMORY = 0.998  # of the counts per frame
LEAST_SEEN = 200.0  # counts of own and of other pixels, below which colors say nothing
RARE = 5e-5  # added to the share of each color: one seldom seen says little


class Appearance:
    """Colors of own and of other pixels, as seen so far."""

    def __init__(self):
        self._counts = np.zeros((2, BINS, BINS, BINS), np.float32)  # other, own

    def color_bins(self, image: np.ndarray) -> np.ndarray:
        """Index of each pixel's color, ``(H, W)``, of an image RGB ``(H, W, 3)`` or gray ``(H, W)`` uint8."""
        rgb = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
        lab: Any = cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)
        values = np.arange(256)
        bins = values * BINS // 256
        vivid = np.clip((values - 128) * VIVID + 128, 0, 255) * BINS // 256
        return bins[lab[..., 0]] * BINS**2 + vivid[lab[..., 1]] * BINS + vivid[lab[..., 2]]

    def learn(self, bins: np.ndarray, own: np.ndarray, other: np.ndarray) -> None:
        """Count the colors of own and of other pixels, bool ``(H, W)`` each."""
        self._counts *= np.float32(MEMORY)
        seen = [np.bincount(bins[pixels], minlength=BINS**3) for pixels in (other, own)]
        self._counts += np.reshape(seen, self._counts.shape)

    def log_odds(self, bins: np.ndarray) -> np.ndarray:
        """float32 ``(H, W)``, above 0 where a pixel looks like the body; 0 while too little has been seen."""
        totals = self._counts.sum(axis=(1, 2, 3))
        if totals.min() < LEAST_SEEN:
            return np.zeros(bins.shape, np.float32)
        # A color's neighbors count for it, as light changes.
        shares = self._counts / totals[:, None, None, None]
        for axis in (1, 2, 3):
            shares = 0.25 * np.roll(shares, 1, axis) + 0.5 * shares + 0.25 * np.roll(shares, -1, axis)
        other, own = np.log(shares + np.float32(RARE)).reshape(2, -1)
        return (own - other).astype(np.float32)[bins]
