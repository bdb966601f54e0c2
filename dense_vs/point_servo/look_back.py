"""Features of the present image followed back through those before, in place of waiting for images to come."""

from collections.abc import Sequence

import numpy as np

from dense_vs.point_servo.body_features import Keyframe
from dense_vs.point_servo.feature_flow import carried
from dense_vs.point_servo.feature_looks import FeatureLooks


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
    looks = FeatureLooks()
    looks.take(np.arange(len(begun)), gray, begun)
    left, places, later = np.arange(len(begun)), begun.copy(), gray
    kept = [Keyframe(np.array(q, dtype=np.float64), numbers, places, gray)]
    for image, q in [*history[:-1]][::-1]:
        found, believed = carried(later, image, places, places)
        left, places, later = left[believed], found[believed], image
        places, _, alike = looks.held(left, image, places)
        left, places = left[alike], places[alike]
        kept.append(Keyframe(np.array(q, dtype=np.float64), numbers[left], places, image))
    return kept[::-1]
