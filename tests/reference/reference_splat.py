"""The image of points on links at a posture: which is in front at every pixel."""

import numpy as np

_NEAREST = 1e-6
_SIDES = 4
_AROUND = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def front_points(places: np.ndarray, depths: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Index of the point that is in front at each pixel, ``(H, W)``, -1 where none is.

    A point covers the pixel that it falls on; pixels between points that spread apart take the nearest neighbor's.

    Args:
        places: ``(P, 2)`` x, y [px].
        depths: ``(P,)``, points at or behind the camera are left out.
        size: (H, W).
    """
    height, width = size
    u, v = np.rint(places).astype(np.int64).T if len(places) else (np.zeros(0, np.int64),) * 2
    inside = (depths > _NEAREST) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    chosen = np.flatnonzero(inside)
    chosen = chosen[np.argsort(-depths[chosen], kind="stable")]  # the nearest is written last
    front = np.full(height * width, -1)
    front[v[chosen] * width + u[chosen]] = chosen
    return _filled(front.reshape(size), depths)


def _filled(front: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """Pixels with points on at least four of eight sides take the nearest of these; and so twice."""
    rows, columns = np.flatnonzero((front >= 0).any(axis=1)), np.flatnonzero((front >= 0).any(axis=0))
    if not len(rows):
        return front
    part = front[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    for _ in range(2):
        height, width = part.shape
        known = np.zeros((height + 2, width + 2), np.uint8)
        known[1:-1, 1:-1] = part >= 0
        sides = sum(known[1 + a : 1 + a + height, 1 + b : 1 + b + width] for a, b in _AROUND)
        y, x = np.nonzero((part < 0) & (sides >= _SIDES))
        if not len(y):
            break
        padded = np.pad(part, 1, constant_values=-1)
        around = np.stack([padded[1 + a + y, 1 + b + x] for a, b in _AROUND])
        near = np.where(around >= 0, depths[around], np.inf).argmin(axis=0)
        part[y, x] = around[near, np.arange(len(y))]
    return front
