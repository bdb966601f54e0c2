"""Features of an image that are not where the others of their link are: they have slid, or are taken for another."""

import numpy as np

from dense_vs.arrays import middle
from dense_vs.point_servo.more_features import LEAST_SEEN

GATE = 2.0  # px from where its link's features are, at which one is given up


def off_their_link(off: np.ndarray, directions: np.ndarray, links: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Which features are, bool ``(K,)``.

    Args:
        off: ``(K, 2)``, by which they are seen elsewhere than the chain has them [px].
        directions: ``(K, 2, 2)``, what these are multiplied by.
        links: ``(K,)`` that they are on.
        counted: bool ``(K,)``, those that are seen and known; others are not judged.
    """
    found = np.zeros(len(off), bool)
    for link in np.unique(links[counted]):
        on = counted & (links == link)
        if on.sum() >= LEAST_SEEN:
            far = np.einsum("kij,kj->ki", directions[on], off[on] - middle(off[on]))
            found[on] = np.linalg.norm(far, axis=1) > GATE
    return found
