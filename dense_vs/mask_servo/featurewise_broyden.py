"""The Hadamard-Broyden update (11) of VOS-VS applied to each image feature by itself. Beyond the paper.

In (11) all features share one denominator, dq^T J+ de. While one element of J+ still has the wrong sign its term in
the sum is negative and spoils the update of the others. Where H couples every joint to one feature only, as in all
configurations of Table 1, the features can be learnt apart: each is (11) with k = 1, its denominator its own.
"""

from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden


class FeaturewiseBroyden:
    """Learns J+ ``(n, k)`` by (11), a feature at a time.

    Args:
        pinv0: ``(n, k)`` [rad/px, m/px].
        coupling: H, ``(n, k)`` of 0 and 1, with one 1 in each row.
        alpha: update speed.
        min_motion: motions of a feature's joints with a smaller sum of \\|dq\\| [rad, m] add up until they are learnt
            from; smaller than for (11), as each sum has fewer terms.
        min_change: so do motions that changed the feature by less than this [px]: divided by noise, a motion says
            nothing.

    Raises:
        DenseVSError: as :class:`HadamardBroyden`, or a joint coupled to no feature or to several.
    """

    def __init__(
        self, pinv0: Any, coupling: Any, alpha: float = 0.1, *, min_motion: float = 0.004, min_change: float = 4.0
    ):
        pinv0, coupling = np.asarray(pinv0, dtype=np.float64), np.asarray(coupling, dtype=np.float64)
        if coupling.ndim != 2 or not np.array_equal(coupling.sum(axis=1), np.ones(len(coupling))):
            raise DenseVSError(f"coupling is {coupling.tolist()}; expected one 1 in each row, a feature for each joint")
        self._joints = [np.flatnonzero(column) for column in coupling.T]
        self._shape = coupling.shape
        self.coupling = coupling
        self.min_motion, self._min_change = min_motion, float(min_change)
        self._seen: list[float | None] = [None] * self._shape[1]  # of each feature when last learnt from
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
        """Learn from joint positions ``(n,)`` and feature error ``(k,)``; whether anything was learnt.

        Raises:
            DenseVSError: another shape or a value that is not finite.
        """
        q, e = np.asarray(q, dtype=np.float64), np.asarray(e, dtype=np.float64)
        if (len(q), len(e)) != self._shape:
            raise DenseVSError(f"q and e have lengths {len(q)} and {len(e)}; expected {self._shape}")
        learnt = False
        for k, (joints, learner) in enumerate(zip(self._joints, self._learners, strict=True)):
            seen = self._seen[k]
            if learner is None or (seen is not None and abs(e[k] - seen) < self._min_change):
                continue
            step = learner.observe(q[joints], e[k : k + 1])
            if step is None or step.outcome != "too little motion":
                self._seen[k] = float(e[k])
            learnt |= step is not None and step.changed
        return learnt

    def forget_observation(self) -> None:
        """Begin :meth:`observe` anew, as after the object or the robot was moved by someone else; J+ stays."""
        for learner in self._learners:
            if learner is not None:
                learner.forget_observation()
        self._seen = [None] * self._shape[1]
