"""The servo law on mask features, VOS-VS (10): dq = -lambda J+ e, with limits and a defined end for a lost feature.

It is VOS-VS (8) for joint steps in place of camera velocities; J+ inverts VOS-VS (9), which stands for VOS-VS (7).

Beyond the paper: a command is bounded as a whole, so that its direction stays; joint limits are kept; and while the
feature is not seen nothing is commanded, until after a set number of frames the servo says that it is lost.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError


class FeatureState(StrEnum):
    """State of a feature servo."""

    SERVOING = "servoing"
    CONVERGED = "converged"  # the error is within the tolerance; dq is zero
    WAITING = "waiting"  # the feature is not seen; dq is zero
    LOST = "lost"  # it has not been seen for ``patience`` frames: search


@dataclass(frozen=True)
class FeatureCommand:
    """A command of :meth:`FeatureServo.step`.

    Attributes:
        dq: ``(n,)`` joint step [rad, m].
        error: ``(k,)`` feature error e, VOS-VS (6) [px]; NaN where the feature is not seen.
        state: see :class:`FeatureState`.
        at_limit: ``(n,)`` bool, joints whose step a joint limit shortened.
    """

    dq: np.ndarray
    error: np.ndarray
    state: FeatureState
    at_limit: np.ndarray


class FeatureServo:
    """Computes joint steps that bring image features s to s*.

    Args:
        target: s*, ``(k,)`` [px].
        gain: lambda of VOS-VS (10), the share of the error to remove per command.
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
        self.target = number_array(target, "target", (-1,))
        if not self.target.size:
            raise DenseVSError("target is empty; expected at least one feature")
        self.gain = check_number("gain", gain, least=0.0)
        self.tolerance = check_number("tolerance", tolerance, least=0.0)
        self.patience = check_whole("patience", patience, least=1)
        self.max_step = None if max_step is None else number_array(max_step, "max_step", finite=False)
        if self.max_step is not None and (self.max_step.ndim > 1 or not (self.max_step > 0).all()):
            raise DenseVSError(f"max_step is {max_step!r}; expected a number above 0, or one for each joint")
        self.joint_limits: np.ndarray | None = None
        if joint_limits is not None:
            limits = number_array(joint_limits, "joint_limits", (-1, 2), finite=False)
            if not (limits[:, 0] < limits[:, 1]).all():
                raise DenseVSError(f"joint_limits are {limits.tolist()}; expected (n, 2), least and greatest")
            self.joint_limits = limits
        self.unseen = 0

    def step(self, pinv: Any, features: Any, positions: Any = None) -> FeatureCommand:
        """The next joint step.

        Args:
            pinv: J+, ``(n, k)`` [rad/px, m/px].
            features: s, ``(k,)`` [px]; None or NaN where the object is not seen.
            positions: ``(n,)`` joint positions; needed where there are limits.

        Raises:
            DenseVSError: another shape, a value of ``pinv`` or ``positions`` that is not finite, or a step that is not
                finite where ``max_step`` bounds none.
        """
        k = len(self.target)
        J = number_array(pinv, "pinv", (-1, k))
        n = len(J)
        room = self._room(positions, n)
        step = self._max_step(n)
        nothing, nowhere = np.zeros(n), np.zeros(n, dtype=bool)
        seen = np.full(k, np.nan) if features is None else number_array(features, "features", finite=False)
        if seen.shape != (k,):
            raise DenseVSError(f"features have shape {seen.shape}; expected {(k,)}, as target")
        if not np.isfinite(seen).all():
            self.unseen += 1
            state = FeatureState.LOST if self.unseen >= self.patience else FeatureState.WAITING
            return FeatureCommand(nothing, np.full(k, np.nan), state, nowhere)
        self.unseen = 0
        error = seen - self.target  # VOS-VS (6)
        if np.abs(error).max() <= self.tolerance:
            return FeatureCommand(nothing, error, FeatureState.CONVERGED, nowhere)
        wanted = _shortened(self.gain, J, error, step)
        dq = np.clip(wanted, room[:, 0], room[:, 1])
        return FeatureCommand(dq, error, FeatureState.SERVOING, dq != wanted)

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
        q = number_array(positions, "positions", (n,))
        least, greatest = self.joint_limits[:, 0] - q, self.joint_limits[:, 1] - q
        return np.stack([np.minimum(least, 0.0), np.maximum(greatest, 0.0)], axis=1)


def _shortened(gain: float, J: np.ndarray, error: np.ndarray, most: np.ndarray) -> np.ndarray:
    """-gain J+ e, VOS-VS (10), as a whole no longer than ``most``; finite however large its factors are."""
    with np.errstate(over="ignore", invalid="ignore"):
        wanted = -gain * (J @ error)
        if np.isfinite(wanted).all():
            return wanted / max(1.0, float((np.abs(wanted) / most).max()))
        # Too large for a number: its direction, and the length that is allowed.
        direction = -(J / np.abs(J).max()) @ (error / np.abs(error).max())
        longest = float((np.abs(direction) / most).max())
        wanted = direction / longest if longest > 0 else np.full(len(J), np.inf)
    if not np.isfinite(wanted).all():
        raise DenseVSError(f"step is {wanted.tolist()}; expected a smaller gain or J+, or a max_step")
    return wanted
