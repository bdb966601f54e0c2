"""Where a followed point is by three witnesses, each with a covariance: its body's chain, features, and its own look.

The chain has the point somewhere; features of the point's own image, where they are in sight, are off the chain by what
the point is off as well; and its look is seen somewhere. All are taken together as a Kalman update takes them, so few
features along one edge, or a look that is as plain to one side, count for little. Without such features its look tells
nothing of the place: it is sought far around then, and on plain links something else looks as much like it. What is
left open, and how far the features had to move the place, is its uncertainty: where witnesses disagree one is wrong.

The deviations were found by the truth in 179 ends of reaches of commercial arms (40 views): of the 90 places that are
said to be known best none is more than 1.4 px off, where by sums of terms of before three were 2.0 to 2.3 px off.
"""

import numpy as np

CHAIN = 0.5  # px, deviation of the chain's place each way, beside what its lines leave open
FARTHER = 2.0  # times what :class:`.PlaceErrors` has them leave open: with 7 joints a chain was off by far more
UNKNOWN_LINES = 1.2  # px in its place, where a body model does not say what its lines leave open
FEATURE = 0.7  # px, deviation of a feature across its edge; one that is :data:`LOOSE` off the others counts half
LOOSE = 1.0  # px
ROUNDS = 2  # of weighing them by how they agree
WITHIN = 10.0  # px, in which they are sought to agree
SURPRISE = 4.0  # squared deviations by which features may have a chain off; by more, and it is known less
WIDE = 28.0  # px, standard deviation of the weight by which features tell what the point is off
LOOK, LEAST_LOOK = 1.5, 0.5  # times what a look may have drifted by, and px that count as that at least
BASIC = 0.3  # px, of any place
OFF_SHARE = 0.9  # of how far the features had to move the place
UNTIED = (
    1.2  # px, where no features of the point's own image are in sight and what is at the place is not like its look
)
LIKE, UNLIKE = 0.95, 0.8  # correlations with its look between which it is less, by a share, down to LEAST_UNTIED
LEAST_UNTIED = 0.3
UNSEEN = 0.6  # px, where features of its own image tell a place, but what is there is not like its look
SEEN, NOT_SEEN = 0.85, 0.65  # correlations between which that is so by a share
SMALLEST = 1e-3  # weight of a feature however far away


def off_by_features(
    prior: np.ndarray, off: np.ndarray, directions: np.ndarray, distances: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far a point is from where the chain has it, by features of its link; and the covariance of that.

    Args:
        prior: ``(2, 2)`` [px^2], covariance of the chain's place.
        off: ``(K, 2)`` [px], by which features are seen elsewhere than where the chain has them.
        directions: ``(K, 2, 2)``, what errors of their places are multiplied by.
        distances: ``(K,)`` [px], of the features from the point.
    """
    if not len(off):
        return np.zeros(2), prior
    squares = directions.transpose(0, 2, 1) @ directions
    near = (np.exp(-(distances**2) / (2 * WIDE**2)) + SMALLEST) / FEATURE**2
    weights = near
    for _ in range(ROUNDS):
        mean, alone = _mean_of(off, squares, weights, np.eye(2) / WITHIN**2)
        apart = np.einsum("kij,kj->ki", directions, off - mean)
        weights = near / (1 + np.sum(apart**2, axis=1) / LOOSE**2)
    mean, alone = _mean_of(off, squares, weights, np.eye(2) / WITHIN**2)
    surprise = float(mean @ np.linalg.solve(prior + alone, mean))
    known = np.linalg.inv(prior * max(1.0, surprise / SURPRISE))
    return _mean_of(off, squares, weights, known)


def _mean_of(
    off: np.ndarray, squares: np.ndarray, weights: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean ``(2,)`` and covariance ``(2, 2)`` of weighed measurements, with information ``(2, 2)`` that it is 0."""
    each = weights[:, None, None] * squares
    covariance = np.linalg.inv(known + each.sum(axis=0))
    return covariance @ np.einsum("kij,kj->i", each, off), covariance


def with_look(
    place: np.ndarray, covariance: np.ndarray, seen: np.ndarray, drift: float
) -> tuple[np.ndarray, np.ndarray]:
    """A place ``(2,)`` [px] and its covariance ``(2, 2)`` [px^2], once the point's own look was seen.

    Args:
        place, covariance: before.
        seen: ``(2,)`` [px], where.
        drift: of :meth:`.PointLook.drift` [px].
    """
    noise = (LOOK * max(drift, LEAST_LOOK)) ** 2 * np.eye(2)
    gain = np.linalg.solve(covariance + noise, covariance).T
    return place + gain @ (seen - place), covariance - gain @ covariance


def place_uncertainty(covariance: np.ndarray, offset: np.ndarray, held: bool, correlation: float) -> float:
    """Standard deviation of a point's place each way [px].

    Args:
        covariance: ``(2, 2)`` of the place [px^2], by all that tells of it.
        offset: ``(2,)`` [px], how far features moved it.
        held: whether enough features of the point's own image are in sight.
        correlation: of what is seen at the place with the point's own look.
    """
    open_ = float(np.sqrt(max(np.trace(covariance), 0.0) / 2))
    loose = unseen(correlation) if held else untied(correlation)
    return float(np.linalg.norm([BASIC, open_, OFF_SHARE * float(np.linalg.norm(offset)), loose]))


def unseen(correlation: float) -> float:
    """Standard deviation of a place that features tell [px], by its look's correlation: both should be seen there."""
    return float(np.interp(correlation, (NOT_SEEN, SEEN), (UNSEEN, 0.0)))


def untied(correlation: float) -> float:
    """Standard deviation of a place that no feature of the point's own image tells [px], by its look's correlation."""
    return UNTIED * float(np.clip((LIKE - correlation) / (LIKE - UNLIKE), LEAST_UNTIED, 1.0))
