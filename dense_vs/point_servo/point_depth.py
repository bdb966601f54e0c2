"""At what depth a point of a link is: from its own places, the link's features around it, a body model's surface."""

from dataclasses import dataclass

import numpy as np

NEAR = 14.0  # px, standard deviation of the weight by which features around count
LEAST_SPREAD = 0.03  # of the logarithm of the depth by the features around
RELIEF = 0.0015  # of the logarithm by px to the next feature: surfaces are aslant by some 25 degrees
LEAST_NEAR = 3  # features on the link
SURFACE = 0.02  # of the logarithm of a body model's surface, found on six views of commercial arms
BULGE = 0.006  # of the logarithm: links are nearer between their edges, which tell depth; found on 16 views
OWN_PLACES = 10  # as many places of its own count, however many there are: they share their errors
OUTLINES = 0.012  # of the logarithm: what a look holds of outlines at other depths pulls all its places alike
NOISE = 0.5  # px, of its own places
RANGE, STEPS = 0.25, 251  # of the logarithm of the depth about that of the features around
ASIDE = 5  # steps, over which the cost's curvature is measured
UNKNOWN = 0.25  # standard deviation of the logarithm where nothing tells
# Of a depth that features and surface tell, fitted to how far points went astray in 26 views of commercial arms:
APART_SHARE = 0.55  # of the logarithm of their ratio
RELIEF_SHARE = 1.8  # of the standard deviation of the logarithm of the surface's depths about the point
LEAST_SHARE = 0.7  # of its own deviation, which hardly differs from point to point
MOST_DEVIATION = 0.055  # of what features say: others are too far away to be a witness


@dataclass(frozen=True)
class PointDepth:
    """Depth, in the unit of the chain, and the standard deviation of its logarithm."""

    depth: float
    deviation: float


def depth_of_features(places: np.ndarray, depths: np.ndarray, point: np.ndarray) -> PointDepth | None:
    """Robust mean depth of features ``(K, 2)`` [px], ``(K,)`` about a point ``(2,)`` [px]; None for too few."""
    if len(depths) < LEAST_NEAR:
        return None
    weights = np.exp(-np.sum((places - point) ** 2, axis=1) / (2 * NEAR**2)) + 1e-4
    inverse = 1 / depths
    mean, heavy = float(np.average(inverse, weights=weights)), weights
    for _ in range(4):
        spread = np.sqrt(np.average((inverse - mean) ** 2, weights=heavy))
        heavy = weights / (1 + ((inverse - mean) / max(1.5 * spread, 1e-4 * mean)) ** 2)
        mean = float(np.average(inverse, weights=heavy))
    spread = float(np.sqrt(np.average((inverse - mean) ** 2, weights=heavy)))
    apart = float(np.linalg.norm(places - point, axis=1).min())
    return PointDepth(1 / mean, float(np.hypot(max(spread / mean, LEAST_SPREAD), RELIEF * apart)))


def together(one: PointDepth | None, other: PointDepth | None) -> PointDepth | None:
    """What two sources say of a depth, None for one that says nothing; where they disagree both are doubted more."""
    if one is None or other is None:
        return one or other
    precision = one.deviation**-2 + other.deviation**-2
    off = float(np.log(other.depth / one.depth))
    doubt = max(1.0, abs(off) / float(np.hypot(one.deviation, other.deviation)))
    depth = one.depth * float(np.exp(off * other.deviation**-2 / precision))
    return PointDepth(depth, doubt / float(np.sqrt(precision)))


def witnessed(found: PointDepth, features: PointDepth | None, surface: PointDepth | None, relief: float) -> PointDepth:
    """A depth with the deviation that two sources leave, where both tell of it; else as it is.

    How far they are apart tells more of the error that is left than their own deviations do. So does the relief of the
    surface, the standard deviation of the logarithm of its depths about the point.
    """
    if features is None or surface is None or features.deviation > MOST_DEVIATION:
        return found
    apart = float(np.log(surface.depth / features.depth))
    deviation = float(np.hypot(APART_SHARE * apart, RELIEF_SHARE * relief))
    return PointDepth(found.depth, max(deviation, LEAST_SHARE * found.deviation))


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
    deviation = 1 / np.sqrt(max(curvature / 2, 1 / UNKNOWN**2))
    own = OUTLINES if errors.shape[1] else 0.0
    return PointDepth(around.depth * float(np.exp(steps[best])), float(np.hypot(deviation, own)))


def tried_depths(around: PointDepth) -> np.ndarray:
    """``(STEPS,)`` depths about that of the features around."""
    return around.depth * np.exp(np.linspace(-RANGE, RANGE, STEPS))
