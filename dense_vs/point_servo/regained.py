"""Features that went out of sight, sought where the chain has them by now, looking as they have to look there.

Features that are followed from image to image are lost as a link turns, and those that replace them are placed by the
chain as it was when they came into sight: they do not know what the chain is off since. Those of the point's own image
do. As the surface that they are on is seen again, or still, each is compared as it has to appear in the present
posture; one alone may be mistaken, but those of one rigid link have to agree on how far the chain is off.
"""

import numpy as np

from dense_vs.body_model.image_directions import direction_weights
from dense_vs.point_servo.body_features import BodyFeatures
from dense_vs.point_servo.feature_looks import FeatureLooks

MOST_OFF = 5.0  # px from where it is expected
AGREED = 1.0  # px from how far the others are off, in the direction in which a place counts
LEAST_AGREED = 4  # features, and of those that are sure a share
LEAST_SHARE = 0.5
ROUNDS = 3  # of taking those that agree with the middle of the ones that did before
LEAST_SCALE, MOST_SCALE = 0.5, 2.0  # by which a look may have shrunk or grown in any direction
MARGIN = 8  # px from the image's border
BESIDE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # px, of what tells how a look is turned


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
    expected, maps = _views(features, numbers, seen_at, q)
    expected = expected + offset
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
        middle = np.median(off[agreed], axis=0)
        agreed = np.linalg.norm(np.einsum("kij,kj->ki", directions, off - middle), axis=1) < AGREED
        if not agreed.any():
            break
    if agreed.sum() < max(LEAST_AGREED, LEAST_SHARE * len(off)):
        return numbers[:0], places[:0]
    return numbers[agreed], places[agreed]


def _views(
    features: BodyFeatures, numbers: np.ndarray, seen_at: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Expected places ``(K, 2)`` [px] and maps ``(K, 2, 2)`` of px about them in the first image to px there."""
    links = features.links[numbers]
    rotation, translation = features.chain.link_poses(np.array([seen_at, q]))
    first = features.positions(numbers, seen_at)  # (K, 3)
    beside = (features.pixels(first)[:, None] + BESIDE).reshape(-1, 2)
    there = features.rays(beside).reshape(-1, 3, 3) * first[:, None, 2:]
    home = np.einsum("kij,kbi->kbj", rotation[0, links], there - translation[0, links][:, None])
    now = np.einsum("kij,kbj->kbi", rotation[1, links], home) + translation[1, links][:, None]
    places = features.pixels(now.reshape(-1, 3)).reshape(-1, 3, 2)
    return places[:, 0], np.stack([places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]], axis=-1)
