"""Whether a joint moves by as much as its readings say: its gain, told by the motion that they leave unexplained.

A belt that slips between a motor's encoder and its joint, or a gear that skips, makes the joint move by another share
of what is read. Everything that this joint moves then moves by that share, and what is left over of the flow u after
J dq is a multiple of this joint's own part of J dq, at every place alike. No change of the scene and no J that lags
behind looks like that for several motions in a row, so a joint's gain is believed once motions agree on it. J stays
what it was (beyond the papers, which believe every reading).
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from dense_vs.arrays import quantile
from dense_vs.health.motion_check import LEAST_PLACES, Motion

EXCITED = 0.5  # px that a joint has to move enough places by, for a motion to tell its gain
LEAST_CHANGE = 0.18  # of a gain, that counts
MOST_LEFT = 0.5  # of the error at half of the places, that may be left with the changed gain
MOST_UNKNOWN = 0.2  # of the flow there, that may be left: where J is wrong in other ways too, it tells no gain
LEAST, MOST = 0.05, 1.15  # gain: what slips moves by less than is read, and no other way
APART = 0.1  # between gains that agree, and from 1 where nothing is wrong
VOTES, OF = 4, 5  # motions that agree, of the last that tell a joint's gain
BETTER = 0.8  # of the error with one gain, that another has to leave for a motion to speak for it
BACK_VOTES, BACK_OF = 3, 4  # motions that speak for a joint that moves as it reads again, of the last that tell


@dataclass(frozen=True)
class GainChange:
    """A joint that moves by another share of its readings than until now.

    Attributes:
        joint: which.
        factor: on the gain until now.
        since: stamp of the image that the first motion that told it begins at [s].
    """

    joint: int
    factor: float
    since: float


class GainCheck:
    """Looks for a changed gain, a motion at a time, for n joints.

    Args:
        joints: n.
    """

    def __init__(self, joints: int):
        self._votes: list[deque[tuple[float, float]]] = [deque(maxlen=OF) for _ in range(joints)]  # factor, begin
        self._back: list[deque[tuple[bool, float]]] = [deque(maxlen=BACK_OF) for _ in range(joints)]

    def restart(self) -> None:
        """Begin anew, as after a change was taken out or the readings had a gap."""
        for votes in (*self._votes, *self._back):
            votes.clear()

    def judge(self, motion: Motion, span: np.ndarray, gains: np.ndarray) -> GainChange | None:
        """A change that this motion and those before it agree on.

        Args:
            motion: between two images.
            span: ``(n,)`` joint displacement of that motion, by the gains until now [rad, m].
            gains: ``(n,)`` of the joints until now.
        """
        told = factors_of(motion, span)
        if told is None:
            return None
        if (ended := self._ended(motion, span, gains)) is not None:
            return ended
        chosen = _most_told(*told, gains)
        for joint, votes in enumerate(self._votes):
            if np.isfinite(told[0][joint]):
                votes.append((told[0][joint] if joint == chosen else 1.0, motion.begin))
        if chosen is None:
            return None
        factors, begins = np.array(self._votes[chosen]).T
        agreed = np.abs(factors - factors[-1]) <= APART
        if np.count_nonzero(agreed) < VOTES:
            return None
        factor = max(float(np.median(factors[agreed])), LEAST / gains[chosen])
        return GainChange(chosen, factor, float(begins[agreed].min()))

    def _ended(self, motion: Motion, span: np.ndarray, gains: np.ndarray) -> GainChange | None:
        """A joint that moves as it reads again, which is asked of every one that slipped until now."""
        error = motion.flow - motion.jacobian @ span
        for joint in np.flatnonzero(gains != 1):
            part = motion.jacobian[..., joint] * span[joint]
            speaks = speaks_for_one(part, part / gains[joint], error)
            if speaks is None:
                continue
            votes = self._back[joint]
            votes.append((speaks, motion.begin))
            begins = [begin for back, begin in votes if back]
            if speaks and len(begins) >= BACK_VOTES:
                return GainChange(int(joint), 1 / float(gains[joint]), begins[0])
        return None


def speaks_for_one(part: np.ndarray, whole: np.ndarray, error: np.ndarray) -> bool | None:
    """Whether a motion speaks for a joint's gain to be 1 again, or for the gain until now; None where for neither.

    Args:
        part: ``(K, 2)`` of the motion that is the joint's by its gain [px]; whole: the same by a gain of 1.
        error: ``(K, 2)``, what J leaves of the flow with the gain until now [px].
    """
    moved = np.isfinite(error).all(axis=1) & (np.linalg.norm(whole, axis=1) >= EXCITED)
    if np.count_nonzero(moved) < LEAST_PLACES:
        return None
    now = quantile(np.hypot(*error[moved].T), 0.5)
    back = quantile(np.hypot(*(error - whole + part)[moved].T), 0.5)
    if back < BETTER * now:
        return True
    return False if now < BETTER * back else None


def factors_of(motion: Motion, span: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """What a motion says of every joint's gain, all others left as they are.

    Args:
        motion: K places.
        span: ``(n,)`` [rad, m].

    Returns:
        Factors ``(n,)``, NaN for a joint that hardly moved the image, and the share ``(n,)`` that each leaves of the
        error at half of the places that it moves, 1 where it leaves too much of the flow; None with too few places.
    """
    parts = motion.jacobian * span  # (K, 2, n)
    error = motion.flow - parts.sum(axis=2)
    finite = np.isfinite(error).all(axis=1)
    if np.count_nonzero(finite) < LEAST_PLACES:
        return None
    parts, error, flow = parts[finite], error[finite], motion.flow[finite]
    lengths, of_flow, of_error = np.hypot(parts[:, 0], parts[:, 1]), np.hypot(*flow.T), np.hypot(*error.T)
    factors, left = np.full(len(span), np.nan), np.ones(len(span))
    for joint in np.flatnonzero((lengths >= EXCITED).sum(axis=0) >= LEAST_PLACES):
        moved = lengths[:, joint] >= EXCITED
        part, of, weights = parts[moved, :, joint], error[moved], lengths[moved, joint] ** 2
        extra = weighted_median((of * part).sum(axis=1) / weights, weights)
        before, moves = quantile(of_error[moved], 0.5), quantile(of_flow[moved], 0.5)
        factors[joint] = 1 + extra
        after = quantile(np.hypot(*(of - extra * part).T), 0.5)
        if before > 0 and after <= MOST_UNKNOWN * moves:
            left[joint] = after / before
    return factors, left


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """The value ``()`` of values ``(K,)`` at which half of the weights ``(K,)`` is reached."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])


def _most_told(factors: np.ndarray, left: np.ndarray, gains: np.ndarray) -> int | None:
    """The joint whose gain a motion says to be another; None where it says so of none."""
    told = np.nan_to_num(factors, nan=1.0)
    possible = (told * gains >= -LEAST) & (told * gains <= MOST)
    changed = (np.abs(told - 1) >= LEAST_CHANGE) & (left <= MOST_LEFT) & possible
    return int(np.argmin(np.where(changed, left, np.inf))) if changed.any() else None
