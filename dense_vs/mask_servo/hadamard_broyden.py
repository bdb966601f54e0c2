"""The Hadamard-Broyden update, VOS-VS (11): learn the pseudoinverse feature Jacobian from motions and what they did.

After a joint step dq changed the feature error by de,

    J+ <- J+ + alpha ((dq - J+ de) dq^T J+ / (dq^T J+ de)) o H

where o is the element-wise product with the logical coupling matrix H. Without H it is Broyden's own update of the
inverse. Beyond the paper, the denominator is guarded: on its way from a wrong sign to the right one an element
passes a point where the denominator vanishes and one update could be as large as you like.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError

MOTION_THRESHOLD = 0.02  # sum of |dq|, the authors' robot code


class BroydenOutcome(StrEnum):
    """Outcome of an update: J+ changed, or why it did not."""

    UPDATED = "updated"  # VOS-VS (11) as it stands
    GUARDED = "guarded"  # its denominator was held away from zero
    TOO_LITTLE_MOTION = "too little motion"
    NO_CHANGE = "no change of features"
    NO_ESTIMATE = "no estimate"  # the prediction or the denominator is zero
    OVERFLOW = "overflow"


@dataclass(frozen=True)
class BroydenStep:
    """One call of :meth:`HadamardBroyden.update`.

    Attributes:
        outcome: see :class:`BroydenOutcome`.
        pinv: ``(n, k)``, the estimate after the call.
        denominator: dq^T J+ de as it was, before the guard.
    """

    outcome: BroydenOutcome
    pinv: np.ndarray
    denominator: float

    @property
    def changed(self) -> bool:
        """Whether the estimate was changed."""
        return self.outcome in (BroydenOutcome.UPDATED, BroydenOutcome.GUARDED)


class HadamardBroyden:
    """Learns ``dq = J+ de``, the inverse of VOS-VS (9), online, for n joints and k image features.

    Args:
        pinv0: ``(n, k)`` [rad/px, m/px], the estimate to begin with; the paper uses 0.001 H.
        coupling: H, ``(n, k)`` of 0 and 1: which joint answers for which feature; None is the original Broyden update.
        alpha: update speed, 0 to 1; 0 keeps the estimate, as the paper does once J+ is learned.
        min_motion: motions with a smaller sum of \\|dq\\| [rad, m] are not learned from; the authors' code uses 0.02.
        min_cosine: the denominator's least magnitude, as the cosine between dq and J+ de; 0 is VOS-VS (11) as printed.

    Attributes:
        pinv: ``(n, k)``, the present estimate; a copy.
        history: a :class:`BroydenStep` for every update call since the beginning.

    Raises:
        DenseVSError: another shape, a value that is not finite, a coupling that is not 0 or 1, an option out of range.
    """

    def __init__(
        self,
        pinv0: Any,
        coupling: Any = None,
        alpha: float = 0.1,
        *,
        min_motion: float = MOTION_THRESHOLD,
        min_cosine: float = 0.05,
    ):
        self._pinv = number_array(pinv0, "pinv0", (-1, -1)).copy()
        if not self._pinv.size:
            raise DenseVSError(f"pinv0 has shape {self._pinv.shape}; expected (joints, features), at least 1 of each")
        self.coupling = None if coupling is None else _logical(coupling, self._pinv.shape)
        self.alpha = check_number("alpha", alpha, least=0.0, most=1.0)
        self.min_motion = check_number("min_motion", min_motion, least=0.0)
        self.min_cosine = check_number("min_cosine", min_cosine, least=0.0, most=1.0)
        self.history: list[BroydenStep] = []
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def pinv(self) -> np.ndarray:
        """The present estimate of J+, float64 ``(n, k)``."""
        return self._pinv.copy()

    def update(self, dq: Any, de: Any) -> BroydenStep:
        """Learn from one motion, VOS-VS (11).

        Args:
            dq: ``(n,)`` [rad, m], joint positions now less those at the last update.
            de: ``(k,)`` [px], the feature error's change between the same instants.

        Raises:
            DenseVSError: another shape or a value that is not finite; the estimate stays as it was.
        """
        n, k = self._pinv.shape
        dq = number_array(dq, "dq", (n,))
        de = number_array(de, "de", (k,))
        step = self._learn(dq, de)
        self._pinv = step.pinv.copy()
        self.history.append(step)
        return step

    def observe(self, q: Any, e: Any) -> BroydenStep | None:
        """:meth:`update` with the change since the last observation that was learned from.

        Small motions so add up until there are enough of them, as the paper's "changes since the last update" say.

        Args:
            q: ``(n,)`` [rad, m], joint positions.
            e: ``(k,)`` [px], the feature error at that instant.

        Returns:
            The step; None for the first observation.

        Raises:
            DenseVSError: as :meth:`update`.
        """
        n, k = self._pinv.shape
        q = number_array(q, "q", (n,)).copy()
        e = number_array(e, "e", (k,)).copy()
        if self._last is None:
            self._last = (q, e)
            return None
        step = self.update(q - self._last[0], e - self._last[1])
        if step.outcome is not BroydenOutcome.TOO_LITTLE_MOTION:
            self._last = (q, e)
        return step

    def forget_observation(self) -> None:
        """Begin :meth:`observe` anew, as after the object or the robot was moved by someone else; J+ stays."""
        self._last = None

    def _learn(self, dq: np.ndarray, de: np.ndarray) -> BroydenStep:
        J = self._pinv
        predicted = J @ de
        denominator = float(dq @ predicted)

        def kept(outcome: BroydenOutcome) -> BroydenStep:
            return BroydenStep(outcome, J.copy(), denominator)

        if np.abs(dq).sum() <= self.min_motion:
            return kept(BroydenOutcome.TOO_LITTLE_MOTION)
        if not de.any():
            return kept(BroydenOutcome.NO_CHANGE)
        size = float(np.linalg.norm(dq) * np.linalg.norm(predicted))
        if size == 0.0:
            return kept(BroydenOutcome.NO_ESTIMATE)
        floor = self.min_cosine * size
        held = denominator if abs(denominator) >= floor else float(np.copysign(floor, denominator))
        if held == 0.0:
            return kept(BroydenOutcome.NO_ESTIMATE)
        with np.errstate(all="ignore"):
            change = np.outer(dq - predicted, dq @ J) / held  # VOS-VS (11)
            if self.coupling is not None:
                change = change * self.coupling
            learned = J + self.alpha * change
        if not np.isfinite(learned).all():
            return kept(BroydenOutcome.OVERFLOW)
        outcome = BroydenOutcome.UPDATED if held == denominator else BroydenOutcome.GUARDED
        return BroydenStep(outcome, learned, denominator)


def _logical(coupling: Any, shape: tuple[int, ...]) -> np.ndarray:
    given = np.asarray(coupling) if isinstance(coupling, np.ndarray) else None
    flags = given is not None and given.dtype == bool
    matrix = number_array(given.astype(float) if flags and given is not None else coupling, "coupling", shape)
    if not np.isin(matrix, (0, 1)).all():
        raise DenseVSError(f"coupling is {matrix.tolist()}; expected 0 and 1 in the shape {shape} of pinv0")
    return matrix
