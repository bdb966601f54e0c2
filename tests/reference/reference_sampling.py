"""Bilinear interpolation, the interpolate() of DIJE (13) to (16), in float64."""

import numpy as np


def bilinear(image, x, y):
    """Values of ``image`` (H, W, ...) at places of any shape; outside, the nearest border pixel's."""
    image = np.asarray(image, dtype=np.float64)
    height, width = image.shape[:2]
    x = np.clip(np.asarray(x, dtype=np.float64), 0, width - 1)
    y = np.clip(np.asarray(y, dtype=np.float64), 0, height - 1)
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    per_pixel = (...,) + (None,) * (image.ndim - 2)
    a, b = (x - x0)[per_pixel], (y - y0)[per_pixel]
    return (
        (1 - a) * (1 - b) * image[y0, x0]
        + a * (1 - b) * image[y0, x1]
        + (1 - a) * b * image[y1, x0]
        + a * b * image[y1, x1]
    )


def pixel_grid(height, width):
    """x and y of every pixel, each (H, W)."""
    y, x = np.mgrid[:height, :width].astype(np.float64)
    return x, y


def moved_image(image, displacement, iterations):
    """(13) and (14): every pixel takes the value of ``image`` at its old place y.

    y = x - v(x), repeated as y = x - v(y); ``iterations`` is 0 for no motion. A pixel whose own displacement is
    not a number stays where it is.
    """
    x, y = pixel_grid(*image.shape[:2])
    if iterations == 0:
        return np.array(image, dtype=np.float64)
    v = np.array(displacement, dtype=np.float64)
    unknown = ~np.isfinite(v).all(axis=2)
    v[unknown] = 0
    shift = v
    for _ in range(iterations - 1):
        shift = bilinear(v, x - shift[..., 0], y - shift[..., 1])
        shift[unknown] = 0
    return bilinear(image, x - shift[..., 0], y - shift[..., 1])
