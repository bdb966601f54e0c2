"""The servo law of VOS-VS on mask features (10): dq = -lambda J+ e, with limits and a defined end for a lost feature.

Beyond the paper: a command is bounded as a whole, so that its direction stays; joint limits are kept; and while the
feature is not seen nothing is commanded, until after a set number of frames the servo says that it is lost.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.errors import DenseVSError

State = Literal["servoing", "converged", "waiting", "lost"]


@dataclass(frozen=True)
class FeatureCommand:
    """What :meth:`FeatureServo.step` commands.

    Attributes:
        dq: ``(n,)`` joint step [rad, m].
        error: ``(k,)`` feature error e (6) [px]; NaN where the feature is not seen.
        state: ``"servoing"``; ``"converged"``, the error is within the tolerance and dq is zero; ``"waiting"``, the
            feature is not seen and dq is zero; ``"lost"``, it has not been seen for ``patience`` frames: search.
        at_limit: ``(n,)`` bool, joints whose step a joint limit shortened.
    """

    dq: np.ndarray
    error: np.ndarray
    state: State
    at_limit: np.ndarray


class FeatureServo:
    """Computes joint steps that bring image features s to s*.

    Args:
        target: s*, ``(k,)`` [px].
        gain: lambda of (10), the share of the error to remove per command.
        max_step: ``(n,)`` or one number for all [rad, m], the largest step of each joint per command; a step beyond
            it is shortened as a whole. None bounds nothing.
        joint_limits: ``(n, 2)`` least and greatest position; None keeps none.
        tolerance: largest \\|e_j\\| [px] that counts as converged.
        patience: frames without the feature until it counts as lost.

    Raises:
        DenseVSError: another shape, a value that is not finite, an option out of range.
    """

    def __init__(
        self,
        target: Any,
        gain: float = 1.0,
        *,
        max_step: Any = None,
        joint_limits: Any = None,
        tolerance: float = 5.0,
        patience: int = 10,
    ):
        self.target = real_vector(np.asarray(target, dtype=np.float64), "target", (-1,))
        for name, value in (("gain", gain), ("tolerance", tolerance)):
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or value < 0:
                raise DenseVSError(f"{name} is {value!r}; expected a finite number of at least 0")
        if isinstance(patience, bool) or not isinstance(patience, (int, np.integer)) or patience < 1:
            raise DenseVSError(f"patience is {patience!r}; expected a whole number of at least 1")
        self.gain, self.tolerance, self.patience = float(gain), float(tolerance), int(patience)
        self.max_step = None if max_step is None else np.asarray(max_step, dtype=np.float64)
        if self.max_step is not None and (self.max_step.ndim > 1 or not (self.max_step > 0).all()):
            raise DenseVSError(f"max_step is {max_step!r}; expected a number above 0, or one for each joint")
        self.joint_limits = None if joint_limits is None else np.asarray(joint_limits, dtype=np.float64)
        if self.joint_limits is not None:
            limits = self.joint_limits
            if limits.ndim != 2 or limits.shape[1] != 2 or not (limits[:, 0] < limits[:, 1]).all():
                raise DenseVSError(f"joint_limits are {limits.tolist()}; expected (n, 2), least and greatest")
        self.unseen = 0

    def step(self, pinv: Any, features: Any, positions: Any = None) -> FeatureCommand:
        """The next joint step.

        Args:
            pinv: J+, ``(n, k)`` [rad/px, m/px].
            features: s, ``(k,)`` [px]; None or NaN where the object is not seen.
            positions: ``(n,)`` joint positions; needed where there are limits.

        Raises:
            DenseVSError: another shape, or a value of ``pinv`` or ``positions`` that is not finite.
        """
        k = len(self.target)
        J = real_vector(np.asarray(pinv, dtype=np.float64), "pinv", (-1, k))
        n = len(J)
        room = self._room(positions, n)
        step = self._max_step(n)
        nothing, nowhere = np.zeros(n), np.zeros(n, dtype=bool)
        seen = np.full(k, np.nan) if features is None else np.asarray(features, dtype=np.float64)
        if seen.shape != (k,):
            raise DenseVSError(f"features have shape {seen.shape}; expected {(k,)}, as target")
        if not np.isfinite(seen).all():
            self.unseen += 1
            state: State = "lost" if self.unseen >= self.patience else "waiting"
            return FeatureCommand(nothing, np.full(k, np.nan), state, nowhere)
        self.unseen = 0
        error = seen - self.target
        if np.abs(error).max() <= self.tolerance:
            return FeatureCommand(nothing, error, "converged", nowhere)
        wanted = -self.gain * (J @ error)
        wanted = wanted / max(1.0, float((np.abs(wanted) / step).max()))
        dq = np.clip(wanted, room[:, 0], room[:, 1])
        return FeatureCommand(dq, error, "servoing", dq != wanted)

    def reset(self) -> None:
        """Forget how long the feature has not been seen."""
        self.unseen = 0

    def _max_step(self, n: int) -> np.ndarray:
        if self.max_step is None:
            return np.full(n, np.inf)
        if self.max_step.ndim and self.max_step.shape != (n,):
            raise DenseVSError(f"max_step has shape {self.max_step.shape}; expected one number or {(n,)}, as pinv")
        return np.broadcast_to(self.max_step, (n,))

    def _room(self, positions: Any, n: int) -> np.ndarray:
        """Least and greatest step of each joint; a joint outside its limits may come back, not go further out."""
        if self.joint_limits is None:
            return np.tile([-np.inf, np.inf], (n, 1))
        if len(self.joint_limits) != n:
            raise DenseVSError(f"pinv has {n} joints; expected {len(self.joint_limits)}, as joint_limits")
        if positions is None:
            raise DenseVSError("positions are missing; expected the joint positions, as there are joint limits")
        q = real_vector(np.asarray(positions, dtype=np.float64), "positions", (n,))
        least, greatest = self.joint_limits[:, 0] - q, self.joint_limits[:, 1] - q
        return np.stack([np.minimum(least, 0.0), np.maximum(greatest, 0.0)], axis=1)
