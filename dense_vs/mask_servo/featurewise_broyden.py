"""The Hadamard-Broyden update, VOS-VS (11), applied to each image feature by itself. Beyond the paper.

In VOS-VS (11) all features share one denominator, dq^T J+ de. While one element of J+ still has the wrong sign, its
term in the sum is negative and spoils the update of the others. Where H couples every joint to one feature only, as in
all configurations of Table 1, each feature can be learned alone, by (11) with k = 1 and a denominator of its own.
"""

from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.hadamard_broyden import BroydenOutcome, HadamardBroyden


class FeaturewiseBroyden:
    """Learns J+ ``(n, k)`` by VOS-VS (11), a feature at a time.

    Args:
        pinv0: ``(n, k)`` [rad/px, m/px].
        coupling: H, ``(n, k)`` of 0 and 1, with one 1 in each row.
        alpha: update speed.
        min_motion: motions of a feature's joints with a smaller sum of \\|dq\\| [rad, m] add up until they are learned
            from; smaller than for :class:`HadamardBroyden`, as each sum has fewer terms.
        min_change: so do motions that changed the feature by less than this [px]: divided by noise, a motion says
            nothing.

    Raises:
        DenseVSError: as :class:`HadamardBroyden`, or a joint coupled to no feature or to several.
    """

    def __init__(
        self, pinv0: Any, coupling: Any, alpha: float = 0.1, *, min_motion: float = 0.004, min_change: float = 4.0
    ):
        pinv0 = number_array(pinv0, "pinv0", (-1, -1))
        coupling = number_array(coupling, "coupling")
        logical = coupling.shape == pinv0.shape and np.isin(coupling, (0, 1)).all()
        if not logical or not np.array_equal(coupling.sum(axis=1), np.ones(len(coupling))):
            raise DenseVSError(f"coupling is {coupling.tolist()}; expected one 1 in each row, a feature for each joint")
        self._joints = [np.flatnonzero(column) for column in coupling.T]
        self._shape = coupling.shape
        self.coupling = coupling
        self.min_motion, self._min_change = min_motion, check_number("min_change", min_change, least=0.0)
        self._seen: list[float | None] = [None] * self._shape[1]  # of each feature when last learned from
        self._learners = [
            HadamardBroyden(pinv0[joints, k : k + 1], np.ones((len(joints), 1)), alpha, min_motion=min_motion)
            if joints.size
            else None
            for k, joints in enumerate(self._joints)
        ]

    @property
    def pinv(self) -> np.ndarray:
        """The present estimate of J+, float64 ``(n, k)``."""
        pinv = np.zeros(self._shape)
        for k, (joints, learner) in enumerate(zip(self._joints, self._learners, strict=True)):
            if learner is not None:
                pinv[joints, k] = learner.pinv[:, 0]
        return pinv

    def observe(self, q: Any, e: Any) -> bool:
        """Learn from joint positions ``(n,)`` and feature error ``(k,)``; whether anything was learned.

        Raises:
            DenseVSError: another shape or a value that is not finite.
        """
        q, e = number_array(q, "q", self._shape[:1]), number_array(e, "e", self._shape[1:])
        learned = False
        for k, (joints, learner) in enumerate(zip(self._joints, self._learners, strict=True)):
            seen = self._seen[k]
            if learner is None or (seen is not None and abs(e[k] - seen) < self._min_change):
                continue
            step = learner.observe(q[joints], e[k : k + 1])
            if step is None or step.outcome is not BroydenOutcome.TOO_LITTLE_MOTION:
                self._seen[k] = float(e[k])
            learned |= step is not None and step.changed
        return learned

    def forget_observation(self) -> None:
        """Begin :meth:`observe` anew, as after the object or the robot was moved by someone else; J+ stays."""
        for learner in self._learners:
            if learner is not None:
                learner.forget_observation()
        self._seen = [None] * self._shape[1]
