"""Features of the present image followed back through those before, in place of waiting for images to come."""

from collections.abc import Sequence

import numpy as np

from dense_vs.point_servo.body_features import Keyframe
from dense_vs.point_servo.feature_flow import carried
from dense_vs.point_servo.surface_patches import SurfacePatches

WINDOW = 15  # px, side of the patches by which features are compared
SURE, REALIGNED = 0.9, 1.0  # correlation with the first look, and px, for a place to be corrected by that look
UNLIKE = 0.5  # correlation at which a feature is given up


def followed_back(
    history: Sequence[tuple[np.ndarray, np.ndarray]], numbers: np.ndarray, begun: np.ndarray
) -> list[Keyframe]:
    """Features of the last image of a history, followed back to the first one: a keyframe of every image.

    Args:
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad], oldest first.
        numbers: ``(K,)`` indices of the features.
        begun: ``(K, 2)``, where they are in the last image [px].
    """
    gray, q = history[-1]
    patches = SurfacePatches(WINDOW)
    pixels = patches.taken(gray, begun)
    maps = np.tile(np.eye(2), (len(begun), 1, 1))
    left, places, later = np.arange(len(begun)), begun.copy(), gray
    kept = [Keyframe(np.array(q, dtype=np.float64), numbers, places, gray)]
    for image, q in [*history[:-1]][::-1]:
        found, believed = carried(later, image, places, places)
        left, places, later = left[believed], found[believed], image
        if len(left):
            aligned, turned, correlation = patches.align(pixels[left], image, places, maps[left])
            sure = (correlation > SURE) & (np.linalg.norm(aligned - places, axis=1) < REALIGNED)
            places = np.where(sure[:, None], aligned, places)
            maps[left[sure]] = turned[sure]
            alike = correlation > UNLIKE
            left, places = left[alike], places[alike]
        kept.append(Keyframe(np.array(q, dtype=np.float64), numbers[left], places, image))
    return kept[::-1]
