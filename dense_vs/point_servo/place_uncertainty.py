"""How far a followed point may be from where it is believed to be: by its depth, its link's features and its own look.

Features of the point's own image, where they are in sight, tie its place to how it was defined: what the chain is off
since, it is off for them as well. Others were placed by the chain as it was when they came into sight, so they agree
with it however far it is off; then only the point's own look tells of that. No other term is of the chain: true errors
went with the depth's, and not with how far the link had turned. Shares and terms were fitted to true errors in 31 views
of commercial arms, those of a place that is not tied to another 32, what few features leave open alone to six.
"""

from dataclasses import dataclass

import numpy as np

DEPTH_SHARE = 1.2  # of the depth's standard deviation
HELD_SHARE = 0.8  # of it where features of the point's own first image are in sight, which share most of its error
SEEN_SHARE = 0.5  # of it where its own look is seen as well
OFF_SHARE = 0.5  # of how far the own look, or the features, are from where the chain has them: one of two is wrong
BASIC, FEW = 0.3, 1.5  # px, of any place; by the number of features that tell it, among which wrong ones go unseen
FEW_ALONE = 5.0  # px, in place of FEW where what is at the place is not like the point's own look
UNTIED = 1.2  # px, where no feature of the point's own image is in sight, and what is at the place is not like its look
LIKE, UNLIKE = 0.95, 0.8  # correlations with its look between which it is less, by a share, down to LEAST_UNTIED
LEAST_UNTIED = 0.3
STRANGE = 0.5  # correlation at which nothing is left of its look


@dataclass(frozen=True)
class OwnLook:
    """What the point's own look says of its place.

    Attributes:
        correlation: with its first look; -1 where it is not found.
        deviation: standard deviation of the place by it [px]; infinite where it does not count.
        apart: what is added as it and the features tell of different places [px].
    """

    correlation: float = -1.0
    deviation: float = np.inf
    apart: float = 0.0


def place_uncertainty(
    by_depth: np.ndarray, offset: np.ndarray, held: bool, told: int, aside: float, look: OwnLook
) -> float:
    """Standard deviation of a point's place [px].

    Args:
        by_depth: ``(2,)`` [px], how far it is off for one standard deviation of its depth.
        offset: ``(2,)`` [px], how far the features are from where the chain has them.
        held: whether they are from the image in which the point was defined.
        told: their number.
        aside: standard deviation of their mean [px].
        look: of the point.
    """
    seen = SEEN_SHARE if np.isfinite(look.deviation) else HELD_SHARE
    depth = (seen if held else DEPTH_SHARE) * float(np.linalg.norm(by_depth))
    features = OFF_SHARE * float(np.linalg.norm(offset)), few(look.correlation) / max(told, 1)
    by_link = float(np.linalg.norm([depth, *features, 0.0 if held else untied(look.correlation), aside]))
    both = by_link / float(np.hypot(1.0, by_link / look.deviation))  # two witnesses, by their variances
    return float(np.hypot(both, look.apart))


def few(correlation: float) -> float:
    """What few features leave open of a place, times their number [px], by its look's correlation.

    Of a Fetch's white gripper whose look was not seen again (seed 88, realistic), places by five features were 1.5 px
    off (root mean square) where they were taken to be known to 0.7 px. Where looks were seen, those of four other views
    were 0.2 to 0.7 px off and taken to be known to 0.4 to 0.8 px.
    """
    strange = float(np.clip((UNLIKE - correlation) / (UNLIKE - STRANGE), 0.0, 1.0))
    return FEW + strange * (FEW_ALONE - FEW)


def untied(correlation: float) -> float:
    """Standard deviation of a place that no feature of the point's own image tells [px], by its look's correlation."""
    return UNTIED * float(np.clip((LIKE - correlation) / (LIKE - UNLIKE), LEAST_UNTIED, 1.0))
