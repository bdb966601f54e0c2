"""Smoothing of one image along the edges of another: the guided filter of He, Sun and Tang (2013), with a color guide.

In every window the output is linear in the guide's color; its coefficients are found at half the size, which is
their fast variant of 2015.
"""

import cv2
import numpy as np


def guided_filter(guide: np.ndarray, values: np.ndarray, radius: int, flatness: float) -> np.ndarray:
    """Smooth ``values`` within the surfaces of ``guide``.

    Args:
        guide: RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``.
        values: float32 ``(H, W)``.
        radius: of the windows [px].
        flatness: variance of the guide, in units of its full range, below which a window counts as flat.

    Returns:
        float32 ``(H, W)``.
    """
    rgb = guide if guide.ndim == 3 else cv2.cvtColor(guide, cv2.COLOR_GRAY2RGB)
    whole = rgb.astype(np.float32) / 255
    height, width = values.shape
    half = max(width // 2, 1), max(height // 2, 1)
    color = cv2.resize(whole, half, interpolation=cv2.INTER_AREA)
    small = cv2.resize(values.astype(np.float32), half, interpolation=cv2.INTER_AREA)
    side = 2 * max(radius // 2, 1) + 1

    def mean(image: np.ndarray) -> np.ndarray:
        return cv2.blur(image, (side, side), borderType=cv2.BORDER_REFLECT)

    mean_color, mean_value = mean(color), mean(small)
    with_value = mean(color * small[..., None]) - mean_color * mean_value[..., None]
    red, green, blue = np.moveaxis(color, 2, 0)
    products = mean(np.dstack([red * red, green * green, blue * blue])) - mean_color**2 + np.float32(flatness)
    mixed = np.dstack([green * blue, red * blue, red * green])
    mixed = mean(mixed) - mean_color[..., [1, 0, 0]] * mean_color[..., [2, 2, 1]]
    slope = _solved(products, mixed, with_value)
    offset = mean_value - np.sum(slope * mean_color, axis=2)
    coefficients = cv2.resize(mean(np.dstack([slope, offset])), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.sum(coefficients[..., :3] * whole, axis=2) + coefficients[..., 3]


def _solved(diagonal: np.ndarray, mixed: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x of A x = right at every pixel, A symmetric 3 x 3 with ``mixed`` its entries 12, 02 and 01."""
    a, b, c = np.moveaxis(diagonal, 2, 0)
    f, e, d = np.moveaxis(mixed, 2, 0)
    cofactors = [[b * c - f * f, e * f - d * c, d * f - e * b], [e * f - d * c, a * c - e * e, d * e - a * f]]
    cofactors.append([d * f - e * b, d * e - a * f, a * b - d * d])
    determinant = a * cofactors[0][0] + d * cofactors[0][1] + e * cofactors[0][2]
    rows = [sum(row[k] * right[..., k] for k in range(3)) / determinant for row in cofactors]
    return np.dstack(rows)
