"""Tells a swaying camera from the robot's own motion, and takes it out of the flow that J is learned from.

What stands still moves in the image as the camera does (:mod:`dense_vs.flow.camera_motion`). It is sought where the
joints move nothing. A camera in the robot's hand moves the image too, and that is what J is to learn: where the joint
steps foretell the camera's motion it is left in, and so it is until enough has been seen to say. Labels are told from
the flow as it is: a wall that sways shows that the joints do not move it, and one that stands still shows nothing.
Beyond the papers.
"""

import numpy as np

from dense_vs.flow.camera_motion import CameraMotion, fit_camera_motion
from dense_vs.jacobian.estimator import DenseJacobian

QUIET = 0.5  # px, J dq of places that count as background
LEAST_BACKGROUND = 0.35  # of all places that have to agree
MOST_SWAY = 3.0  # px a flow; more is a camera that was moved, or a robot that fills the image
LEAST_CARRIED = 0.35  # px, from which the state is moved along; less is less than moving it would blur
JUDGED = 20  # motions until it is known whose they are
FORETOLD = 0.8  # share that the joints foretell, from which the motion is theirs
MEMORY = 0.98  # of what joint steps and camera motion had in common
RIDGE = 1e-2  # of the mean squared step


class CameraSway:
    """Watches one camera.

    Args:
        height, width: of its images [px].
        joints: N.

    Attributes:
        foretold: share of the camera's motion that joint steps foretell, lately; NaN while it does not move.
        traveled: how far the image's middle has been carried in all, x and y [px].
        taken: motions that were taken out; ``unknown``, those that could not be told.
    """

    def __init__(self, height: int, width: int, joints: int):
        self._size = height, width
        self._radius = 0.5 * float(np.hypot(height, width))
        self._waiting = CameraMotion.none()
        self._judged = 0
        self._squares, self._products = np.zeros((joints, joints)), np.zeros((joints, 4))
        self._energy = np.zeros(2)  # of the camera's motion, and what is left of it [px^2]
        self.traveled = np.zeros(2)
        self.taken = self.unknown = 0

    @property
    def foretold(self) -> float:
        """See the class."""
        moved, left = self._energy
        return float(1 - left / moved) if moved > 0 else float("nan")

    def observe(
        self, places: np.ndarray, flow: np.ndarray, jacobian: np.ndarray, span: np.ndarray
    ) -> CameraMotion | None:
        """The camera's motion that is to be taken out of a flow; None where there is none, or it cannot be told.

        Args:
            places: ``(K, 2)`` [px].
            flow: ``(K, 2)`` there [px].
            jacobian: ``(K, 2, N)`` there [px/rad].
            span: ``(N,)`` joint displacement of the flow [rad].
        """
        quiet = np.linalg.norm(np.nan_to_num(jacobian) @ span, axis=1) < QUIET
        motion = fit_camera_motion(places[quiet], flow[quiet])
        known = motion is not None and motion.inliers * quiet.mean() > LEAST_BACKGROUND
        if motion is None or not known or motion.largest(*self._size) > MOST_SWAY:
            self.unknown += 1
            return None
        self._learn_whose(motion, span)
        if self._judged < JUDGED or not self.foretold < FORETOLD:
            return None
        self.taken += 1
        return motion

    def carry(self, motion: CameraMotion, estimator: DenseJacobian) -> None:
        """Move J with the image, once that is worth it."""
        self._waiting = motion.after(self._waiting)
        if self._waiting.largest(*self._size) < LEAST_CARRIED:
            return
        middle = 0.5 * np.array([[self._size[1] - 1, self._size[0] - 1]])
        self.traveled += (self._waiting.moved(middle) - middle)[0]
        stored = estimator.filter.stored()
        estimator.filter.restore(stored | {"state": self._waiting.carried(stored["state"][0])[None]})
        self._waiting = CameraMotion.none()

    def _learn_whose(self, motion: CameraMotion, span: np.ndarray) -> None:
        """Foretell the motion from the joint step by what was seen before, then learn from it."""
        height, width = self._size
        middle = 0.5 * np.array([[width - 1, height - 1]])
        shift = (motion.moved(middle) - middle)[0]
        growth, turn = motion.matrix[0, 0] - 1, motion.matrix[1, 0]
        moved = np.array([*shift, self._radius * growth, self._radius * turn])  # all in px
        known = self._squares + RIDGE * max(np.trace(self._squares) / len(span), 1e-300) * np.eye(len(span))
        foretold = span @ np.linalg.solve(known, self._products) if self._judged else np.zeros(4)
        self._energy = MEMORY * self._energy + [moved @ moved, np.sum((moved - foretold) ** 2)]
        self._squares = MEMORY * self._squares + np.outer(span, span)
        self._products = MEMORY * self._products + np.outer(span, moved)
        self._judged += 1
