"""Which of several objects the hand holds, when the segmenters of more than one take the same thing for theirs.

Beyond the paper, which checks a grasp by the mask of one object, VOS-VS (23): objects of like colors are mistaken for
one another where only one of them is in view. The segmenter that is surer of its mask is believed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.segmentation.mask_quality import assess_mask

SAME = 0.5  # overlap, of the smaller mask, from which on two masks are of one thing


@dataclass(frozen=True)
class HandClaim:
    """What one segmenter sees in the hand.

    Attributes:
        mask: bool ``(H, W)``, empty where its object is not in the hand.
        score: how sure it is of that, to be compared with others'; nan where it does not say.
    """

    mask: np.ndarray
    score: float = float("nan")


def settle_claims(claims: Sequence[HandClaim]) -> list[float]:
    """Areas s_A [px] of the claims, 0 of those that a surer one overlaps; the first wins where scores do not tell.

    Args:
        claims: of the object that was asked for, then of others, masks of one shape.

    Raises:
        DenseVSError: no claim, or masks of different shapes.
    """
    shapes = {claim.mask.shape for claim in claims}
    if len(shapes) != 1:
        raise DenseVSError(f"masks have the shapes {sorted(shapes)}; expected at least one mask, all of one shape")
    order = sorted(range(len(claims)), key=lambda k: -_rank(claims[k], first=k == 0))
    areas = [0.0] * len(claims)
    believed: list[np.ndarray] = []
    for k in order:
        mask = claims[k].mask
        size = np.count_nonzero(mask)
        smaller = [min(size, np.count_nonzero(other)) for other in believed]
        shared = [np.count_nonzero(mask & other) for other in believed]
        if size and not any(common > SAME * least for common, least in zip(shared, smaller, strict=True)):
            areas[k] = float(assess_mask(mask).area)
            believed.append(mask)
    return areas


def _rank(claim: HandClaim, first: bool) -> float:
    """By score; without one, the first before all others and others after all that have one."""
    if np.isfinite(claim.score):
        return float(claim.score) + (1e-9 if first else 0.0)
    return np.inf if first else -np.inf
