"""The image of points on links at a posture: which is in front at every pixel."""

import numpy as np

_NEAREST = 1e-6
_HOLE = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


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
    """Pixels with points on at least five sides take the most frequent depth side's; and so twice."""
    for _ in range(2):
        padded = np.pad(front, 1, constant_values=-1)
        height, width = front.shape
        around = np.stack([padded[1 + a : 1 + a + height, 1 + b : 1 + b + width] for a, b in _HOLE])
        known = around >= 0
        hole = (front < 0) & (known.sum(axis=0) >= 4)
        if not hole.any():
            break
        near = np.where(known[:, hole], depths[around[:, hole]], np.inf).argmin(axis=0)
        front = front.copy()
        front[hole] = around[:, hole][near, np.arange(len(near))]
    return front
