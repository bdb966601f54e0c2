"""What a pixel is told to be the object's by: its channels, and their means and spreads around it at several scales.

Wide surroundings are averaged on a grid of cells of 4 px; a pixel reads the cell that it lies in.
"""

import cv2
import numpy as np

from dense_vs.segmentation.few_shot.pixel_channels import COLOURS, PATTERNS, TEXTURES, PixelChannels

NEAR = (1.0, 2.0)  # standard deviations of the averages [px]
WIDE = (1.0, 2.0, 4.0)  # the same [cells]
CELL = 4  # px

_CHANNELS = COLOURS + TEXTURES


class PixelFeatures:
    """Features of the pixels of one image, computed where they are asked for.

    Args:
        channels: of the image.
    """

    def __init__(self, channels: PixelChannels):
        height, width = channels.patterns.shape
        self._channels = channels
        fine = [*cv2.split(channels.planes), *cv2.split(channels.lab**2)]
        self._near = [[cv2.GaussianBlur(plane, (0, 0), sigma) for plane in fine] for sigma in NEAR]
        cells = (max(width // CELL, 1), max(height // CELL, 1))
        kinds = [np.equal(channels.patterns, kind).view(np.uint8) * np.uint8(255) for kind in range(PATTERNS)]
        coarse = [cv2.resize(plane, cells, interpolation=cv2.INTER_AREA) for plane in [*fine, *kinds]]
        self._wide = [[cv2.GaussianBlur(plane, (0, 0), sigma) for plane in coarse] for sigma in WIDE]
        self._cells = cells

    def at(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Features (m, F) float32 of the pixels at rows y (m,) and columns x (m,)."""
        parts = [self._channels.planes[y, x]]
        row = np.minimum(y // CELL, self._cells[1] - 1)
        column = np.minimum(x // CELL, self._cells[0] - 1)
        for planes, place in [*((p, (y, x)) for p in self._near), *((p, (row, column)) for p in self._wide)]:
            values = np.stack([plane[place] for plane in planes], axis=1).astype(np.float32)
            lightness_and_opponents = slice(_CHANNELS, _CHANNELS + 3)
            square, mean = values[:, lightness_and_opponents], values[:, :3]
            values[:, lightness_and_opponents] = np.sqrt(np.maximum(square - mean**2, 0.0))
            parts.append(values)
        return np.concatenate(parts, axis=1)
