"""A few of many images, evenly spread over a recording."""

import numpy as np


def spread(count: int, most: int) -> np.ndarray:
    """Indices of at most ``most`` of ``count`` items, at about equal distances, the first and the last among them.

    Of one that is asked for, the first.
    """
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
