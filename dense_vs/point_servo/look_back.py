"""Features of the present image followed back through those before, in place of waiting for images to come."""

from collections.abc import Callable, Sequence

import numpy as np

from dense_vs.point_servo.body_features import Keyframe
from dense_vs.point_servo.feature_flow import carried
from dense_vs.point_servo.feature_looks import FeatureLooks

Trace = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""As :meth:`BodyModel.trace`: where what is seen at places ``(K, 2)`` [px] in one posture is in another."""


def followed_back(
    history: Sequence[tuple[np.ndarray, np.ndarray]], numbers: np.ndarray, begun: np.ndarray, trace: Trace | None = None
) -> list[Keyframe]:
    """Features of the last image of a history, followed back to the first one: a keyframe of every image.

    Args:
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad], oldest first.
        numbers: ``(K,)`` indices of the features.
        begun: ``(K, 2)``, where they are in the last image [px].
        trace: of the body, which says where to look for them: from one image of a history to the next a hand moves by
            tens of pixels. They are looked for where they were unless given, and where it does not know them.
    """
    gray, q = history[-1]
    looks = FeatureLooks()
    looks.take(np.arange(len(begun)), gray, begun)
    left, places, later = np.arange(len(begun)), begun.copy(), gray
    posture, before = np.array(q, dtype=np.float64), begun
    kept = [Keyframe(np.array(q, dtype=np.float64), numbers, places, gray)]
    for image, q in [*history[:-1]][::-1]:
        there = begun if trace is None else trace(begun, posture, np.asarray(q, dtype=np.float64))
        found, believed = carried(later, image, places, places + np.nan_to_num(there - before)[left])
        left, places, later, before = left[believed], found[believed], image, there
        places, _, alike = looks.held(left, image, places)
        left, places = left[alike], places[alike]
        kept.append(Keyframe(np.array(q, dtype=np.float64), numbers[left], places, image))
    return kept[::-1]
