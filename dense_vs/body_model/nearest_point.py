"""The surface point at or next to a pixel, as a model's outline is not exact."""

import numpy as np

BESIDE = 3  # px off the body at which a pixel still counts as on it where points are traced


def nearest_point(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Index of the surface point ``(K,)`` at or next to each place ``(K, 2)`` [px], -1 where none is near."""
    height, width = points.shape
    offsets = [(x, y) for x in range(-BESIDE, BESIDE + 1) for y in range(-BESIDE, BESIDE + 1)]
    offsets = sorted((o for o in offsets if o[0] ** 2 + o[1] ** 2 <= BESIDE**2), key=lambda o: o[0] ** 2 + o[1] ** 2)
    u, v = np.rint(np.clip(places, -2 * BESIDE, 2 * max(height, width))).astype(int).T
    index = np.full(len(places), -1)
    for x, y in offsets:
        inside = (index < 0) & (u + x >= 0) & (u + x < width) & (v + y >= 0) & (v + y < height)
        index[inside] = points[v[inside] + y, u[inside] + x]
    return index
