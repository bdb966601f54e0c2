"""The visual servoing law DIJE (17): joint step = k_p J# (p_target - p), in the image or in image and depth.

Beyond the paper: J# is the damped pseudoinverse J^T (J J^T + d^2 I)^-1, which stays small where J is
small or not learned yet; the step is bounded, joint limits are kept by moving the remaining joints, and a small dither
keeps the estimator excited.

With depth (beyond the paper) J has a third row [m/rad] and the error a third number [m]; both are multiplied by the
pixels per meter s = f / Z at the target's depth Z. A camera of focal length f [px] shows a point (X, Y, Z) at
(f X / Z, f Y / Z), so a motion (dX, dY) across the line of sight is s (dX, dY) px. With the third row by s, all rows
count a meter alike: the error is as long as the way in space, times s (near the optical axis), and one damping serves
all. Where the error is zero does not depend on s, so a rough focal length will do.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.arrays import number_array, point_array, real_vector
from dense_vs.checks import check_flags, check_number, check_seed, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.robot.joint_group import checked_limits

RANK_TOLERANCE = 1e-15  # ratio of singular values below which the smaller one is rounding
LEAST_SIZE = 1e-100  # px/rad; a J as small is none
MOST_MOTION = 1e150  # px; the direction of a motion counts, its step is bounded


@dataclass(frozen=True, kw_only=True)
class ServoOptions:
    """How hard the servo pulls.

    Attributes:
        gain: k_p of DIJE (17), the share of the error to remove per command.
        damping: d [px/rad]; 0 is the pseudoinverse of DIJE (17) as printed.
        max_step: largest joint step per command [rad]; a larger one is shortened as a whole.
        dither: standard deviation of the joint step that is added [rad], at most the step's largest entry.
    """

    gain: float = 0.2
    damping: float = 15.0
    max_step: float = 0.03
    dither: float = 0.002

    def __post_init__(self):
        for name in ("gain", "max_step"):
            check_number(name, getattr(self, name), above=0)
        for name in ("damping", "dither"):
            check_number(name, getattr(self, name), least=0)


class VisualServo:
    """Computes the joint step that brings an image point nearer to its target.

    Args:
        joints: number of joints N.
        joint_limits: ``(N, 2)`` least and greatest position [rad]; without them none are kept.
        seed: of the dither.
        gain: k_p, the share of the error to remove per command.
        damping: d [px/rad]; 0 is the pseudoinverse as printed.
        max_step: largest joint step per command [rad]; a larger one is shortened as a whole.
        dither: standard deviation of the joint step that is added [rad], at most the step's largest entry.

    Raises:
        DenseVSError: limits of another shape or in the wrong order, an option out of range.
    """

    def __init__(
        self,
        joints: int,
        *,
        joint_limits: Any = None,
        seed: int = 0,
        gain: float = 0.2,
        damping: float = 15.0,
        max_step: float = 0.03,
        dither: float = 0.002,
    ):
        self.joints = check_whole("joints", joints, least=1, most=4096)
        self.options = ServoOptions(gain=gain, damping=damping, max_step=max_step, dither=dither)
        self.joint_limits = checked_limits(joint_limits, self.joints)
        self._random = np.random.default_rng(check_seed(seed))

    def __call__(
        self,
        jacobian: Any,
        point: Any,
        target: Any,
        positions: Any = None,
        *,
        held: Any = None,
        pixels_per_meter: float | None = None,
    ) -> np.ndarray:
        """Joint step ``(N,)`` [rad] towards the target.

        Args:
            jacobian: ``(2, N)`` [px/rad], J at the point, DIJE (16).
            point, target: ``(2,)`` [px].
            positions: ``(N,)`` joint positions [rad]; needed where there are limits.
            held: bool ``(N,)``, joints that are to stay where they are; the others do without them.
            pixels_per_meter: focal length by depth [px/m]; with it the servo is in depth too: ``jacobian`` is
                ``(3, N)`` with depth [m/rad] as the third row, ``point`` and ``target`` are ``(3,)`` [px, px, m].

        Raises:
            DenseVSError: another shape, a value that is not finite, or positions missing.
        """
        if pixels_per_meter is not None:
            scale = np.array([1.0, 1.0, check_number("pixels_per_meter", pixels_per_meter, above=0)])
            J = real_vector(jacobian, "jacobian", (3, self.joints))
            error = number_array(target, "target", (3,)) - number_array(point, "point", (3,))
            return self._toward(scale[:, None] * J, scale * error, positions, held)
        J = real_vector(jacobian, "jacobian", (2, self.joints))
        return self._toward(J, point_array(target, "target") - point_array(point, "point"), positions, held)

    def together(
        self,
        jacobians: Any,
        points: Any,
        targets: Any,
        weights: Any = None,
        positions: Any = None,
        held: Any = None,
    ) -> np.ndarray:
        """Joint step ``(N,)`` [rad] that brings several points nearer to their targets: DIJE (17) with their J stacked.

        Args:
            jacobians: ``(K, 2, N)`` [px/rad], J at each point.
            points, targets: ``(K, 2)`` [px].
            weights: ``(K,)`` above 0, how much each point's error counts beside the others'; all alike unless given.
                Only their ratios matter: the largest counts as 1.
            positions: ``(N,)`` joint positions [rad]; needed where there are limits.
            held: bool ``(N,)``, joints that are to stay where they are; the others do without them.

        Raises:
            DenseVSError: another shape, a value that is not finite, a weight of 0 or less, or positions missing.
        """
        J = real_vector(jacobians, "jacobians", (-1, 2, self.joints))
        count = len(J)
        error = real_vector(targets, "targets", (count, 2)) - real_vector(points, "points", (count, 2))
        weight = np.ones(count) if weights is None else real_vector(weights, "weights", (count,))
        if not count or (weight <= 0).any():
            raise DenseVSError(f"weights are {weight.tolist()}; expected at least one, all above 0")
        root = np.sqrt(weight / weight.max())[:, None]
        return self._toward((J * root[..., None]).reshape(2 * count, -1), (error * root).ravel(), positions, held)

    def _toward(self, J: np.ndarray, error: np.ndarray, positions: Any, held: Any) -> np.ndarray:
        """The step for an error ``(M,)`` [px] with J ``(M, N)``."""
        with np.errstate(over="ignore"):
            motion = self.options.gain * error
        room = np.array([[-np.inf, np.inf]] * self.joints)
        if np.isfinite(self.joint_limits).any():
            if positions is None:
                raise DenseVSError("positions are missing; expected the joint positions, as there are joint limits")
            q = real_vector(positions, "positions", (self.joints,))
            # A joint outside its limits may come back, not go further out.
            room = np.stack(
                [np.minimum(self.joint_limits[:, 0] - q, 0.0), np.maximum(self.joint_limits[:, 1] - q, 0.0)], axis=1
            )
        if held is not None:
            room[check_flags("held", held, self.joints)] = 0.0
        step = self._within(room, J, np.clip(motion, -MOST_MOTION, MOST_MOTION))
        if self.options.dither and np.any(step):
            step = step + self._random.normal(0.0, min(self.options.dither, np.abs(step).max()), self.joints)
        return np.clip(step, room[:, 0], room[:, 1])

    def _within(self, room: np.ndarray, J: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """DIJE (17), a damped least-squares step for an image motion [px].

        Joints that meet their limit stop there and the others take over what is left.
        """
        step = np.zeros(self.joints)
        free = np.ones(self.joints, dtype=bool)
        for _ in range(self.joints):
            with np.errstate(over="ignore", invalid="ignore"):
                left = motion - J[:, ~free] @ step[~free]
            step[free] = self._solve(J[:, free], np.clip(np.nan_to_num(left), -MOST_MOTION, MOST_MOTION))
            longest = np.abs(step).max()
            if longest > self.options.max_step:
                step *= self.options.max_step / longest
            over = free & ((step < room[:, 0]) | (step > room[:, 1]))
            if not over.any():
                break
            step[over] = np.clip(step[over], room[over, 0], room[over, 1])
            free &= ~over
        return step

    def _solve(self, J: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """J# times a motion, by singular values: J J^T squares them, which loses the small one or overflows."""
        left, sizes, right = np.linalg.svd(J, full_matrices=False)
        damping = self.options.damping
        known = sizes > max(RANK_TOLERANCE * sizes.max(initial=0.0), LEAST_SIZE)
        inverse = np.zeros(len(sizes))
        with np.errstate(over="ignore"):  # s / (s^2 + d^2) without a square of a large number
            inverse[known] = 1 / (sizes[known] + damping * (damping / sizes[known]))
        return right.T @ (inverse * (left.T @ motion))
