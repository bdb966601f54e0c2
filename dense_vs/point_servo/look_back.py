"""Features of the present image followed back through those before, in place of waiting for images to come.

Not in order of time but from posture to posture: from each image to that among the others in which the body is nearest
to how it is there (Prim's tree), so that what one fast motion would lose is found around it.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dense_vs.body_model.feature_flow import carried
from dense_vs.point_servo.body_features import Keyframe
from dense_vs.point_servo.feature_looks import FeatureLooks

Trace = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""As :meth:`BodyModel.trace`: where what is seen at places ``(K, 2)`` [px] in one posture is in another."""


OUTER = 75  # percentile of how far features are apart in two images: what moves most is lost first


def followed_back(
    history: Sequence[tuple[np.ndarray, np.ndarray]], numbers: np.ndarray, begun: np.ndarray, trace: Trace | None = None
) -> list[Keyframe]:
    """Features of the last image of a history, followed to all others: a keyframe of every image.

    Args:
        history: gray images uint8 ``(H, W)`` with joint positions ``(N,)`` [rad], oldest first.
        numbers: ``(K,)`` indices of the features.
        begun: ``(K, 2)``, where they are in the last image [px].
        trace: of the body, which says where to look for them: from one image of a history to another a hand moves by
            tens of pixels. They are looked for where they were unless given, and where it does not know them.
    """
    postures = np.array([q for _, q in history], dtype=np.float64)
    last = len(history) - 1
    expected = np.array([begun if trace is None else trace(begun, postures[last], q) for q in postures])
    looks = FeatureLooks()
    looks.take(np.arange(len(begun)), history[last][0], begun)
    seen = {last: (np.arange(len(begun)), begun.copy())}
    for source, k in _nearest_first(_apart(expected, postures), last):
        left, places = seen[source]
        image, step = history[k][0], np.nan_to_num(expected[k] - expected[source])[left]
        found, believed = carried(history[source][0], image, places, places + step)
        left = left[believed]
        places, _, alike = looks.held(left, image, found[believed])
        seen[k] = left[alike], places[alike]
    return [
        Keyframe(q, numbers[seen[k][0]], seen[k][1], image)
        for k, ((image, _), q) in enumerate(zip(history, postures, strict=True))
    ]


def _apart(expected: np.ndarray, postures: np.ndarray) -> np.ndarray:
    """How far apart images are ``(T, T)``: by the usual distance of places expected in them ``(T, K, 2)`` [px].

    By the joints alone, ``(T, N)`` [rad], where no place is known to move.
    """
    known = expected[:, np.isfinite(expected).all(axis=(0, 2))]
    if known.shape[1] and np.ptp(known, axis=0).any():
        return np.array([np.percentile(np.linalg.norm(known - one, axis=2), OUTER, axis=1) for one in known])
    return np.linalg.norm(postures[:, None] - postures, axis=2)


def _nearest_first(apart: np.ndarray, root: int) -> Iterator[tuple[int, int]]:
    """All others from a root on: pairs of one that was reached before and the one that is nearest to any such."""
    source, left = np.full(len(apart), root), np.arange(len(apart)) != root
    distance = apart[root].copy()
    while left.any():
        k = int(np.where(left, distance, np.inf).argmin())
        yield int(source[k]), k
        left[k] = False
        nearer = apart[k] < distance
        source[nearer], distance[nearer] = k, apart[k][nearer]
