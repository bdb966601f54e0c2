"""The Hadamard-Broyden update of VOS-VS (11): learn the pseudoinverse feature Jacobian from motions and what they did.

After a joint step dq changed the feature error by de,

    J+ <- J+ + alpha ((dq - J+ de) dq^T J+ / (dq^T J+ de)) o H

where o is the element-wise product with the logical coupling matrix H. Without H it is Broyden's own update of the
inverse. Beyond the paper, the denominator is guarded: on its way from a wrong sign to the right one an element
passes a point where the denominator vanishes and one update could be as large as you like.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.errors import DenseVSError

MOTION_THRESHOLD = 0.02  # sum of |dq|, the authors' robot code
Outcome = Literal["updated", "guarded", "too little motion", "no change of features", "no estimate", "overflow"]


@dataclass(frozen=True)
class BroydenStep:
    """One call of :meth:`HadamardBroyden.update`.

    Attributes:
        outcome: ``"updated"`` by (11) as it stands; ``"guarded"``, the denominator was held away from zero; else why
            nothing was changed.
        pinv: ``(n, k)``, the estimate after the call.
        denominator: dq^T J+ de as it was, before the guard.
    """

    outcome: Outcome
    pinv: np.ndarray
    denominator: float

    @property
    def changed(self) -> bool:
        """Whether the estimate was changed."""
        return self.outcome in ("updated", "guarded")


class HadamardBroyden:
    """Learns ``dq = J+ de`` online, for n joints and k image features.

    Args:
        pinv0: ``(n, k)`` [rad/px, m/px], the estimate to begin with; the paper uses 0.001 H.
        coupling: H, ``(n, k)`` of 0 and 1: which joint answers for which feature; None is the original Broyden update.
        alpha: update speed, above 0 (0 keeps the estimate: how the paper uses what it learnt).
        min_motion: motions with a smaller sum of \\|dq\\| [rad, m] are not learnt from; the authors' code uses 0.02.
        min_cosine: the denominator's least magnitude, as the cosine between dq and J+ de; 0 is (11) as printed.

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
        self._pinv = real_vector(np.asarray(pinv0, dtype=np.float64), "pinv0", (-1, -1)).copy()
        if not self._pinv.size:
            raise DenseVSError(f"pinv0 has shape {self._pinv.shape}; expected (joints, features), at least 1 of each")
        self.coupling = None if coupling is None else _logical(coupling, self._pinv.shape)
        self.alpha = _number(alpha, "alpha", 0.0, 1.0)
        self.min_motion = _number(min_motion, "min_motion", 0.0, np.inf)
        self.min_cosine = _number(min_cosine, "min_cosine", 0.0, 1.0)
        self.history: list[BroydenStep] = []
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def pinv(self) -> np.ndarray:
        """The present estimate of J+, float64 ``(n, k)``."""
        return self._pinv.copy()

    def update(self, dq: Any, de: Any) -> BroydenStep:
        """Learn from one motion, (11).

        Args:
            dq: ``(n,)`` [rad, m], joint positions now less those at the last update.
            de: ``(k,)`` [px], the feature error's change between the same instants.

        Raises:
            DenseVSError: another shape or a value that is not finite; the estimate stays as it was.
        """
        n, k = self._pinv.shape
        dq = real_vector(np.asarray(dq, dtype=np.float64), "dq", (n,))
        de = real_vector(np.asarray(de, dtype=np.float64), "de", (k,))
        step = self._learn(dq, de)
        self._pinv = step.pinv.copy()
        self.history.append(step)
        return step

    def observe(self, q: Any, e: Any) -> BroydenStep | None:
        """:meth:`update` with the change since the last observation that was learnt from.

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
        q = real_vector(np.asarray(q, dtype=np.float64), "q", (n,)).copy()
        e = real_vector(np.asarray(e, dtype=np.float64), "e", (k,)).copy()
        if self._last is None:
            self._last = (q, e)
            return None
        step = self.update(q - self._last[0], e - self._last[1])
        if step.outcome != "too little motion":
            self._last = (q, e)
        return step

    def forget_observation(self) -> None:
        """Begin :meth:`observe` anew, as after the object or the robot was moved by someone else; J+ stays."""
        self._last = None

    def _learn(self, dq: np.ndarray, de: np.ndarray) -> BroydenStep:
        J = self._pinv
        predicted = J @ de
        denominator = float(dq @ predicted)

        def kept(outcome: Outcome) -> BroydenStep:
            return BroydenStep(outcome, J.copy(), denominator)

        if np.abs(dq).sum() <= self.min_motion:
            return kept("too little motion")
        if not de.any():
            return kept("no change of features")
        size = float(np.linalg.norm(dq) * np.linalg.norm(predicted))
        if size == 0.0:
            return kept("no estimate")
        floor = self.min_cosine * size
        held = denominator if abs(denominator) >= floor else float(np.copysign(floor, denominator))
        if held == 0.0:
            return kept("no estimate")
        with np.errstate(all="ignore"):
            change = np.outer(dq - predicted, dq @ J) / held
            if self.coupling is not None:
                change = change * self.coupling
            learnt = J + self.alpha * change
        if not np.isfinite(learnt).all():
            return kept("overflow")
        return BroydenStep("updated" if held == denominator else "guarded", learnt, denominator)


def _logical(coupling: Any, shape: tuple[int, ...]) -> np.ndarray:
    matrix = np.asarray(coupling)
    if matrix.shape != shape or matrix.dtype.kind not in "biuf" or not np.isin(matrix, (0, 1)).all():
        raise DenseVSError(
            f"coupling has shape {matrix.shape} and values {matrix.tolist()}; "
            f"expected 0 and 1 in the shape {shape} of pinv0"
        )
    return matrix.astype(np.float64)


def _number(value: Any, name: str, least: float, greatest: float) -> float:
    number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or not least <= value <= greatest:
        raise DenseVSError(f"{name} is {value!r}; expected a finite number from {least:g} to {greatest:g}")
    return float(value)
