"""New features on a body's links, where too few are in sight."""

import numpy as np

from dense_vs.body_model.feature_flow import about, keep_apart, new_features
from dense_vs.point_servo.body_features import BodyFeatures

LEAST_SEEN = 3  # features of a link that have to be in sight for it to be seen
ON_LINK, ON_OTHERS = 70, 25  # features that are kept in sight, of the point's link and of each other one
APART, MARGIN = 4, 9  # px between features; px about those of a link in which new ones are sought
FEW_MARGIN = 20  # px about the point, where fewer than LEAST_SEEN of its link are in sight


def more_features(
    features: BodyFeatures, live: np.ndarray, places: np.ndarray, link: int, point: np.ndarray, gray: np.ndarray
) -> np.ndarray:
    """Places ``(R, 2)`` [px] of new features on and about what is in sight of each link.

    Args:
        features: of the body.
        live: indices ``(K,)`` of those in sight.
        places: ``(K, 2)`` of them [px].
        link: of the point that is followed.
        point: ``(2,)`` [px], where that is.
        gray: uint8 ``(H, W)``.
    """
    free, found = np.ones(gray.shape, np.uint8), []
    keep_apart(free, places, APART)
    for one in [link, *(k for k in np.flatnonzero(features.learned) if k != link)]:
        on = features.seen_on(int(one), live)
        outline = [*places[on], *([point] if one == link else [])]
        wanted = (ON_LINK if one == link else ON_OTHERS) - int(on.sum())
        few = len(outline) < LEAST_SEEN
        if wanted <= 0 or (few and one != link):
            continue
        where = about(np.array(outline), FEW_MARGIN if few else MARGIN, gray.shape)
        new = new_features(gray, where & free, wanted, APART)
        keep_apart(free, new, APART)
        found += [*new]
    return np.array(found).reshape(-1, 2)
