"""Features of a pixel for the few-shot segmenter: color, edges and local binary patterns.

Nothing depends on where in the image a pixel is, and nothing changes when the image turns by a quarter: the same
object is seen from every side.
"""

from dataclasses import dataclass

import cv2
import numpy as np

COLORS = 6  # Lab, two chromaticities, saturation
TEXTURES = 4
PATTERNS = 10  # rotation invariant uniform local binary patterns of 8 neighbors


@dataclass(frozen=True)
class PixelChannels:
    """Channels of an image (h, w)."""

    rgb: np.ndarray  # (h, w, 3) uint8
    planes: np.ndarray  # (h, w, COLORS + TEXTURES) float32, of the order of 1
    patterns: np.ndarray  # (h, w) uint8 below PATTERNS

    @property
    def lab(self) -> np.ndarray:
        """(h, w, 3) lightness 0 to 1 and the color opponents, of like weight."""
        return self.planes[..., :3]


def pixel_channels(image: np.ndarray) -> PixelChannels:
    """Channels of an RGB uint8 image."""
    rgb = image.astype(np.float32) / np.float32(255)
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab) * np.array([0.01, 0.015, 0.015], np.float32)
    red, green, blue = cv2.split(rgb)
    total = red + green + blue + np.float32(0.15)  # keeps the noise of dark pixels small
    most, least = np.maximum(np.maximum(red, green), blue), np.minimum(np.minimum(red, green), blue)
    colors = [(red - green) / total, (2 * blue - red - green) / total, (most - least) / (most + np.float32(0.1))]
    lightness = np.ascontiguousarray(lab[..., 0])
    planes = cv2.merge([*cv2.split(lab), *colors, *_texture(lightness)])
    return PixelChannels(image, planes, _patterns(lightness))


def _texture(lightness: np.ndarray) -> list[np.ndarray]:
    """Lengths of the gradient and of the Laplacian at two scales, normalized for the scale."""
    channels = []
    for sigma in (0.8, 1.6):
        smooth = cv2.GaussianBlur(lightness, (0, 0), sigma)
        dx, dy = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=sigma / 8) for order in ((1, 0), (0, 1)))
        channels += [cv2.magnitude(dx, dy), np.abs(cv2.Laplacian(smooth, cv2.CV_32F, scale=sigma**2 / 4))]
    return channels


def _patterns(lightness: np.ndarray) -> np.ndarray:
    """Local binary patterns of the 8 neighbors at 1 px, Ojala's rotation invariant uniform kinds."""
    height, width = lightness.shape
    padded = cv2.copyMakeBorder(lightness, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    ring = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0))
    threshold = lightness + np.float32(0.01)  # sensor noise makes no pattern
    code = np.zeros((height, width), np.uint8)
    for bit, (y, x) in enumerate(ring):
        code |= (padded[y : y + height, x : x + width] > threshold).view(np.uint8) << bit
    return cv2.LUT(code, _KIND_OF_CODE)


def _kinds() -> np.ndarray:
    """Number of set bits for a code with at most two changes around the ring, else the last kind."""
    table = np.zeros(256, np.uint8)
    for code in range(256):
        bits = [(code >> k) & 1 for k in range(8)]
        changes = sum(bits[k] != bits[k - 1] for k in range(8))
        table[code] = sum(bits) if changes <= 2 else PATTERNS - 1
    return table


_KIND_OF_CODE = _kinds()
