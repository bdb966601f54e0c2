"""What a point is brought to: a place in the image by DIJE (17), with its depth or without."""

from typing import Any

import numpy as np

from dense_vs.arrays import number_array, plain_array, point_array
from dense_vs.body_model import BodyModel
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.followed_depth import FollowedDepth
from dense_vs.point_servo.following import certain
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.tracker import PointTracker


class Aim:
    """Target of the tracked point, and the point's depth where the estimator has depth.

    Args:
        estimator: whose J the point moves by.

    Attributes:
        target: ``(2,)`` [px], ``(3,)`` with depth [m]; None before the first.
    """

    def __init__(self, estimator: DenseJacobian):
        self._estimator = estimator
        self._followed: FollowedDepth | None = None
        self._pixels_per_meter: float | None = None  # at the target's depth; None where it has none
        self.target: np.ndarray | None = None

    @property
    def depth(self) -> float:
        """Depth of the point [m]; NaN where it is not known."""
        return float("nan") if self._followed is None else self._followed.depth

    def certain(self, tracker: PointTracker | BodyTracker, tolerance: float) -> bool:
        """Whether it is known where the point is, to a tolerance [px], in depth too where the target has one."""
        lost = self._pixels_per_meter is not None and self._followed is not None and self._followed.lost
        return certain(tracker, tolerance) and not lost

    def follow(self, point: np.ndarray) -> None:
        """Begin with a point ``(2,)`` [px]."""
        self._followed = FollowedDepth.found(self._estimator, point)

    def update(self, point: np.ndarray, dq: np.ndarray, image: np.ndarray | None) -> None:
        """Take the point's depth along; arguments of :meth:`FollowedDepth.update`."""
        if self._followed is not None:
            self._followed.update(self._estimator, point, dq, image)

    def at(self, target: Any, point: np.ndarray, body: BodyModel | None) -> None:
        """Set the target.

        Args:
            target: ``(2,)`` [px]; ``(3,)`` [px, px, m] where the estimator has depth.
            point: ``(2,)`` [px], where the point is.
            body: knows the focal length; without it, that of a lens that sees 53 degrees across is taken.

        Raises:
            DenseVSError: anything else, depth that is not above 0, or a point whose depth is not known; the target
                stays as it was.
        """
        if plain_array(target, "target", "numbers").shape != (3,):
            self.target, self._pixels_per_meter = point_array(target, "target"), None
            return
        if not self._estimator.options.depth:
            raise DenseVSError("target has 3 numbers; expected 2, an image point, or a loop with ServoLoop(depth=True)")
        place = number_array(target, "target", (3,))
        if place[2] <= 0:
            raise DenseVSError(f"target is {place.tolist()}; expected x, y [px] and a depth above 0 [m]")
        if self._followed is None:
            self._followed = FollowedDepth(self._estimator, point)
        focal_length = float(self._estimator.options.width) if body is None else body.focal_length
        self.target, self._pixels_per_meter = place, focal_length / float(place[2])

    def distance(self, point: np.ndarray) -> float:
        """How far the point at ``(2,)`` [px] is from the target [px]; a meter of depth counts as across the image."""
        assert self.target is not None  # a reach has set it
        off = self._place(point) - self.target
        return float(np.linalg.norm(np.append(off[:2], off[2:] * (self._pixels_per_meter or 0.0))))

    def step(
        self,
        servo: VisualServo,
        point: np.ndarray,
        jacobian: np.ndarray,
        moved: np.ndarray,
        positions: np.ndarray,
        held: np.ndarray,
    ) -> np.ndarray:
        """Joint step ``(N,)`` [rad] toward the target.

        Args:
            servo: the law.
            point: ``(2,)`` [px], where the point was in the last image.
            jacobian: ``(2, N)`` [px/rad] of the point there; that of a target with depth is the estimator's.
            moved: ``(N,)`` joint step since [rad].
            positions: ``(N,)`` joint positions [rad].
            held: bool ``(N,)``, joints that stay.

        Raises:
            DenseVSError: there is no target yet.
        """
        if self.target is None:
            raise DenseVSError("no target is set; expected reach() first")
        J = jacobian if self._pixels_per_meter is None else self._estimator.at(point, depth=True)[0]  # DIJE (16)
        place = self._place(point) + J @ moved
        return servo(J, place, self.target, positions, held=held, pixels_per_meter=self._pixels_per_meter)

    def _place(self, point: np.ndarray) -> np.ndarray:
        """Where the point is, in what the target is given in."""
        return point if self._pixels_per_meter is None else np.append(point, self.depth)
