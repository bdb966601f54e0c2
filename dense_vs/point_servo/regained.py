"""Features that went out of sight, sought where the chain has them by now, looking as they have to look there.

Features that are followed from image to image are lost as a link turns, and those that replace them are placed by the
chain as it was when they came into sight: they do not know what the chain is off since. Those of the point's own image
do. As the surface that they are on is seen again, or still, each is compared as it has to appear in the present
posture; one alone may be mistaken, but those of one rigid link have to agree on how far the chain is off.
"""

import numpy as np

from dense_vs.arrays import middle
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.point_servo.body_features import BodyFeatures
from dense_vs.point_servo.feature_looks import FeatureLooks
from dense_vs.point_servo.turned_view import turned_view

MOST_OFF = 5.0  # px from where it is expected
AGREED = 1.0  # px from how far the others are off, in the direction in which a place counts
LEAST_AGREED = 4  # features, and a share of those that are sure
LEAST_SHARE = 0.5
LEAST_FOUND = 0.3  # of those that are sought: sought image after image, four of 39 agreed that were not there
ROUNDS = 3  # of taking those that agree with the middle of the ones that did before
LEAST_SCALE, MOST_SCALE = 0.5, 2.0  # by which a look may have shrunk or grown in any direction
MARGIN = 8  # px from the image's border


def regained(
    features: BodyFeatures,
    looks: FeatureLooks,
    numbers: np.ndarray,
    seen_at: np.ndarray,
    gray: np.ndarray,
    q: np.ndarray,
    offset: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Those of some features of one link that are seen.

    Args:
        features: of the body.
        looks: of them.
        numbers: ``(K,)``, features that are known.
        seen_at: ``(N,)`` [rad], posture in which their looks were taken.
        gray: uint8 ``(H, W)``, the present image.
        q: ``(N,)`` [rad], posture of it.
        offset: ``(2,)`` [px], how far the link seems to be from where the chain has it.

    Returns:
        Their numbers ``(R,)`` and places ``(R, 2)`` [px]; none where they do not agree.
    """
    first, links = features.positions(numbers, seen_at), features.links[numbers]
    places, maps = turned_view(features, features.pixels(first), first[:, 2], links, seen_at, q[None])
    expected, maps = places[0] + offset, maps[0]
    scales = np.linalg.svd(maps, compute_uv=False)
    size = np.array(gray.shape[::-1])
    inside = ((expected > MARGIN) & (expected < size - 1 - MARGIN)).all(axis=1)
    ready = inside & (scales[:, 1] > LEAST_SCALE) & (scales[:, 0] < MOST_SCALE) & (np.linalg.det(maps) > 0)
    numbers, expected, maps = numbers[ready], expected[ready], maps[ready]
    places, sure = looks.sought(numbers, gray, expected, maps, MOST_OFF)
    numbers, places, off = numbers[sure], places[sure], (places - expected)[sure]
    if len(numbers) < LEAST_AGREED:
        return numbers[:0], places[:0]
    directions = direction_weights(gray, places)
    agreed = np.ones(len(off), bool)
    for _ in range(ROUNDS):
        usual = middle(off[agreed])
        agreed = np.linalg.norm(np.einsum("kij,kj->ki", directions, off - usual), axis=1) < AGREED
        if not agreed.any():
            break
    if agreed.sum() < max(LEAST_AGREED, LEAST_SHARE * len(off), LEAST_FOUND * ready.sum()):
        return numbers[:0], places[:0]
    return numbers[agreed], places[agreed]
