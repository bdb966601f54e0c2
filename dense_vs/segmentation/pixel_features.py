"""What the few-shot segmenter knows about a pixel: colour, texture and edges around it at several scales.

Nothing depends on where in the image a pixel is, and nothing changes when the image turns by a quarter: the same
object is seen from every side. Every channel is a smooth image on a grid of its own resolution, brought to the
output grid by interpolation.
"""

import cv2
import numpy as np

# Standard deviations [px of the output grid] over which colours and textures are averaged.
POOLING = (1.0, 2.0, 4.0, 8.0, 16.0)
PATTERN_BINS = 10  # rotation invariant uniform local binary patterns of 8 neighbours


def pixel_features(image: np.ndarray) -> np.ndarray:
    """Features of every pixel.

    Args:
        image: RGB uint8 ``(h, w, 3)``, already at the resolution that is classified.

    Returns:
        float32 ``(h, w, F)``.
    """
    colour = _colour_channels(image)
    texture = _texture_channels(colour[..., 0])
    patterns = _local_binary_patterns(colour[..., 0])
    planes = [colour]
    for sigma in POOLING:
        mean = _pool(colour, sigma)
        square = _pool(colour[..., :3] ** 2, sigma)
        planes += [mean, np.sqrt(np.maximum(square - mean[..., :3] ** 2, 0.0)), _pool(texture, sigma)]
    planes += [_pool(patterns, sigma) for sigma in (4.0, 12.0)]
    return np.concatenate(planes, axis=2)


def _colour_channels(image: np.ndarray) -> np.ndarray:
    """Lab, two chromaticities that brightness cancels in, and saturation: (h, w, 6)."""
    rgb = image.astype(np.float32) / 255
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab) / np.float32(100)
    total = rgb.sum(axis=2) + np.float32(0.15)
    red, green, blue = (rgb[..., c] for c in range(3))
    chroma = np.stack([(red - green) / total, (2 * blue - red - green) / total], axis=2)
    saturation = (rgb.max(axis=2) - rgb.min(axis=2)) / (rgb.max(axis=2) + np.float32(0.1))
    return np.concatenate([lab, chroma, saturation[..., None]], axis=2)


def _texture_channels(lightness: np.ndarray) -> np.ndarray:
    """Length of the gradient and of the second derivative at two scales: (h, w, 4)."""
    channels = []
    for sigma in (0.8, 1.6):
        smooth = cv2.GaussianBlur(lightness, (0, 0), sigma)
        dx, dy = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=sigma / 8) for order in ((1, 0), (0, 1)))
        channels += [cv2.magnitude(dx, dy), np.abs(cv2.Laplacian(smooth, cv2.CV_32F, scale=sigma**2 / 4))]
    return np.stack(channels, axis=2)


def _local_binary_patterns(lightness: np.ndarray) -> np.ndarray:
    """One-hot rotation invariant uniform patterns of 8 neighbours at 1 px: (h, w, PATTERN_BINS)."""
    height, width = lightness.shape
    padded = cv2.copyMakeBorder(lightness, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    ring = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0))
    threshold = lightness + np.float32(0.01)  # sensor noise makes no pattern
    code = np.zeros((height, width), np.uint8)
    for bit, (y, x) in enumerate(ring):
        code |= (padded[y : y + height, x : x + width] > threshold).astype(np.uint8) << bit
    kinds = cv2.LUT(code, _PATTERN_OF_CODE)
    return (kinds[..., None] == np.arange(PATTERN_BINS, dtype=np.uint8)).astype(np.float32)


def _pattern_table() -> np.ndarray:
    """Ojala's mapping: number of bits for a pattern with at most two changes around the ring, else the last bin."""
    table = np.zeros(256, np.uint8)
    for code in range(256):
        bits = [(code >> k) & 1 for k in range(8)]
        changes = sum(bits[k] != bits[k - 1] for k in range(8))
        table[code] = sum(bits) if changes <= 2 else PATTERN_BINS - 1
    return table


_PATTERN_OF_CODE = _pattern_table()


def _pool(planes: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian average; wide ones on a coarser grid, where a kernel is never wider than it needs to be."""
    height, width = planes.shape[:2]
    factor = max(1, 2 ** int(np.floor(np.log2(max(sigma, 1.0) / 1.5))))
    small = planes
    if factor > 1:
        size = (max(1, width // factor), max(1, height // factor))
        small = _by_fours(planes, lambda four: cv2.resize(four, size, interpolation=cv2.INTER_AREA))
    small = _by_fours(small, lambda four: cv2.GaussianBlur(four, (0, 0), sigma / factor))
    if factor > 1:
        small = _by_fours(small, lambda four: cv2.resize(four, (width, height), interpolation=cv2.INTER_LINEAR))
    return small


def _by_fours(planes: np.ndarray, operation) -> np.ndarray:
    """An OpenCV operation on many channels, four at a time as some of them allow no more."""
    parts = []
    for first in range(0, planes.shape[2], 4):
        part = operation(np.ascontiguousarray(planes[..., first : first + 4]))
        parts.append(part if part.ndim == 3 else part[..., None])
    return np.concatenate(parts, axis=2)
