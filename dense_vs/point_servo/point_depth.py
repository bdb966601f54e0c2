"""At what depth a point of a link is: from its own places, the link's features around it, a body model's surface."""

from dataclasses import dataclass, field, replace

import numpy as np

NEAR = 20.0  # px, standard deviation of the weight by which features around count
LEAST_SPREAD = 0.03  # of the logarithm of the depth by the features around
SLOPE = 0.003  # of the logarithm by px, standard deviation: surfaces are aslant by some 45 degrees
LEAST_INVERSE = 0.5  # of the usual inverse depth, to which a plane may go down at the point
RELIEF = 0.0015  # of the logarithm by px to the next feature: surfaces are aslant by some 25 degrees
LEAST_NEAR = 3  # features on the link
SURFACE = 0.015  # of the logarithm of a body model's surface, less its slip (:mod:`.plainness`)
OWN_PLACES = 10  # as many places of its own count, however many there are: they share their errors
OWN = 0.018  # of the logarithm by its own places, less their slip: an error that all of them share
NOISE = 0.5  # px, of its own places
RANGE, STEPS = 0.25, 251  # of the logarithm of the depth about that of the features around
ASIDE = 5  # steps, over which the cost's curvature is measured
UNKNOWN = 0.25  # standard deviation of the logarithm where nothing tells
# Of a depth that features and surface tell, fitted to how far it is off at 714 places of 37 views of commercial arms:
APART_SHARE = 0.16  # of the logarithm of their ratio
RELIEF_SHARE = 0.85  # of the standard deviation of the logarithm of the surface's depths about the point
PLAIN_SHARE = 0.008  # where the image is plain
LEAST_SHARE = 0.7  # of its own deviation, which hardly differs from point to point
MOST_DEVIATION = 0.055  # of what features say: others are too far away to be a witness


@dataclass(frozen=True)
class PointDepth:
    """Depth, in the unit of the chain, and the standard deviation of its logarithm.

    Attributes:
        slope: ``(2,)`` by which the logarithm grows by px to the right and down, as far as it is known.
    """

    depth: float
    deviation: float
    slope: np.ndarray = field(default_factory=lambda: np.zeros(2), compare=False)


def depth_of_features(places: np.ndarray, depths: np.ndarray, point: np.ndarray) -> PointDepth | None:
    """Depth at a point ``(2,)`` [px] of a surface through features ``(K, 2)`` [px], ``(K,)``; None for too few.

    Inverse depth is linear across a plane. Features mostly lie to one side of a point, next to a link's end: their mean
    would be that of the middle of the link.
    """
    if len(depths) < LEAST_NEAR:
        return None
    away = places - point
    weights = np.exp(-np.sum(away**2, axis=1) / (2 * NEAR**2)) + 1e-4
    inverse = 1 / depths
    usual = float(np.average(inverse, weights=weights))
    terms = np.column_stack([np.ones(len(depths)), away])
    little_slope = np.diag([0.0, 1.0, 1.0]) * (LEAST_SPREAD / SLOPE) ** 2
    heavy, plane, spread = weights, np.array([usual, 0.0, 0.0]), 0.0
    for _ in range(5):
        plane = np.linalg.solve(terms.T @ (heavy[:, None] * terms) + little_slope, terms.T @ (heavy * inverse))
        off = inverse - terms @ plane
        spread = float(np.sqrt(np.average(off**2, weights=heavy)))
        heavy = weights / (1 + (off / max(1.5 * spread, 1e-4 * usual)) ** 2)
    apart = float(np.linalg.norm(away, axis=1).min())
    deviation = float(np.hypot(max(spread / usual, LEAST_SPREAD), RELIEF * apart))
    here = max(float(plane[0]), LEAST_INVERSE * usual)
    return PointDepth(1 / here, deviation, -plane[1:] / here)


def together(one: PointDepth | None, other: PointDepth | None) -> PointDepth | None:
    """What two sources say of a depth, None for one that says nothing; where they disagree both are doubted more."""
    if one is None or other is None:
        return one or other
    precision = one.deviation**-2 + other.deviation**-2
    off = float(np.log(other.depth / one.depth))
    doubt = max(1.0, abs(off) / float(np.hypot(one.deviation, other.deviation)))
    depth = one.depth * float(np.exp(off * other.deviation**-2 / precision))
    return PointDepth(depth, doubt / float(np.sqrt(precision)))


def farther(depth: PointDepth | None, slip: float) -> PointDepth | None:
    """A depth whose logarithm is greater by ``slip``."""
    return None if depth is None else replace(depth, depth=depth.depth * float(np.exp(slip)))


def witnessed(
    found: PointDepth, features: PointDepth | None, surface: PointDepth | None, relief: float, plain: float
) -> PointDepth:
    """A depth with the deviation that two sources leave, where both tell of it; else as it is.

    More is left where the image is plain (:func:`.plainness`), where the surface has relief, the standard deviation of
    the logarithm of its depths about the point, and a little where the two are apart.
    """
    if features is None or surface is None or features.deviation > MOST_DEVIATION:
        return found
    apart = float(np.log(surface.depth / features.depth))
    left = APART_SHARE * apart, RELIEF_SHARE * relief, PLAIN_SHARE * plain, LEAST_SHARE * found.deviation
    return PointDepth(found.depth, float(np.linalg.norm(left)))


def point_depth(around: PointDepth, errors: np.ndarray) -> PointDepth:
    """The most likely depth.

    Args:
        around: by the features around.
        errors: ``(STEPS, T)`` distances of the point's own T places from the expected ones [px], at each of
            :func:`tried_depths`.
    """
    steps = np.linspace(-RANGE, RANGE, STEPS)
    counted = max(1.0, errors.shape[1] / OWN_PLACES)
    cost = np.log1p((errors / NOISE) ** 2).sum(axis=1) / counted + (steps / around.deviation) ** 2
    best = int(np.argmin(cost))
    middle = min(max(best, ASIDE), STEPS - 1 - ASIDE)
    size = steps[1] - steps[0]
    curvature = (cost[middle - ASIDE] - 2 * cost[middle] + cost[middle + ASIDE]) / (ASIDE * size) ** 2
    before, after = around.deviation**2, 1 / max(curvature / 2, 1 / UNKNOWN**2)
    # What the places say is of one error more, which all of them share.
    own = OWN**2 if errors.shape[1] else 0.0
    share = before**2 / (before**2 + own * max(before - after, 0.0))
    return PointDepth(
        around.depth * float(np.exp(share * steps[best])), float(np.sqrt(before - share * (before - after)))
    )


def tried_depths(around: PointDepth) -> np.ndarray:
    """``(STEPS,)`` depths about that of the features around."""
    return around.depth * np.exp(np.linspace(-RANGE, RANGE, STEPS))
