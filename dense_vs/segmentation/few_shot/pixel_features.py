"""Per-pixel features that separate object from background: channels, their means and spreads at several scales.

Wide surroundings are averaged on a grid of cells of 4 px; a pixel reads the cell that it lies in.
"""

import cv2
import numpy as np

from dense_vs.segmentation.few_shot.pixel_channels import COLORS, PATTERNS, TEXTURES, PixelChannels

NEAR = (1.0, 2.0)  # standard deviations of the averages [px]
WIDE = (1.0, 2.0, 4.0)  # the same [cells]
CELL = 4  # px

_CHANNELS = COLORS + TEXTURES
_FULL = (np.eye(PATTERNS) * 255).astype(np.uint8)  # a pixel's kind of pattern as a share of each, in 255ths


class PixelFeatures:
    """Features of the pixels of one image, computed where they are asked for.

    Args:
        channels: of the image.
    """

    def __init__(self, channels: PixelChannels):
        height, width = channels.patterns.shape
        self._channels = channels
        fine = np.concatenate([channels.planes, channels.lab**2], axis=2)
        self._near = [cv2.GaussianBlur(fine, (0, 0), sigma) for sigma in NEAR]
        cells = (max(width // CELL, 1), max(height // CELL, 1))
        coarse = [_reduced(planes, cells) for planes in (fine, _FULL[channels.patterns])]
        self._wide = [[cv2.GaussianBlur(planes, (0, 0), sigma) for planes in coarse] for sigma in WIDE]
        self._cells = cells

    def at(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Features (m, F) float32 of the pixels at rows y (m,) and columns x (m,)."""
        across, down = self._cells
        pixel = y * self._channels.patterns.shape[1] + x
        cell = np.minimum(y // CELL, down - 1) * across + np.minimum(x // CELL, across - 1)
        parts = [_rows(self._channels.planes, pixel), *(_with_spread(_rows(planes, pixel)) for planes in self._near)]
        for fine, kinds in self._wide:
            parts += [_with_spread(_rows(fine, cell)), _rows(kinds, cell)]
        return np.concatenate(parts, axis=1, dtype=np.float32)


def _rows(planes: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Planes (h, w, c) at the places (m,): (m, c)."""
    return planes.reshape(-1, planes.shape[2]).take(place, axis=0)


def _with_spread(values: np.ndarray) -> np.ndarray:
    """Means (m, C + 3) of the channels and of Lab's squares, these as standard deviations."""
    lab, squares = values[:, :3], values[:, _CHANNELS:]
    squares[:] = np.sqrt(np.maximum(squares - lab**2, 0.0))
    return values


def _reduced(planes: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Planes (h, w, c) averaged over the cells of a grid of (width, height)."""
    return cv2.merge([cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in cv2.split(planes)])
