"""Whether the image moved as the joints say, by the innovation u - J dq of a whole image.

At places on the robot the share |u - J s|^2 / (|u|^2 + |J s|^2) is near 0 where flow u and joint step s belong
together, 1 where one of them is missing or the two are strangers. Its median over the places is compared with what is
usual for this robot, so that a J that is known badly is no reason to stop learning it.
"""

import numpy as np

from dense_vs.health.faults import Fault, FaultKind

MOVING = 0.7  # px of flow or J s: places that move less say nothing
ON_ROBOT = 0.2  # of the largest |J| on the image: places with less are not looked at
LEAST_PLACES = 12
KNOWN = 20  # judgments until it is known what is usual
TRUSTED = 0.15  # usual share above which J is known too badly to judge by
LEAST_SHARE = 0.35  # that counts
TIMES_USUAL = 4.0
USUAL = 0.05  # weight of the newest judgment
GIVEN_UP = 40  # judgments in a row, after which not the images but the robot or the camera has changed


class MotionCheck:
    """Judges flow against J, an image at a time."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what is usual, as after J was forgotten."""
        self.share = float("nan")
        self.usual: float | None = None
        self._judged = self._wrong = 0

    def judge(self, flow: np.ndarray, jacobian: np.ndarray, span: np.ndarray) -> Fault | None:
        """What is wrong with an image's motion, where something is.

        Args:
            flow: ``(K, 2)`` at K places [px].
            jacobian: ``(K, 2, N)`` there [px/rad].
            span: ``(N,)`` joint displacement that the flow spans [rad].
        """
        size = np.linalg.norm(jacobian, axis=(1, 2))
        predicted = jacobian @ span
        energy = (flow**2).sum(axis=1) + (predicted**2).sum(axis=1)
        moving = np.maximum((flow**2).sum(axis=1), (predicted**2).sum(axis=1)) > MOVING**2
        chosen = (size > ON_ROBOT * size.max(initial=0.0)) & moving & np.isfinite(energy)
        if np.count_nonzero(chosen) < LEAST_PLACES:
            return None
        error = ((flow[chosen] - predicted[chosen]) ** 2).sum(axis=1)
        self.share = float(np.median(error / energy[chosen]))
        known = self.usual is not None and self._judged >= KNOWN and self.usual < TRUSTED
        if known and self.usual is not None and self.share > max(LEAST_SHARE, TIMES_USUAL * self.usual):
            self._wrong += 1
            if self._wrong < GIVEN_UP:
                text = f"a share of {self.share:.2f} of the motion is not the joints'; {self.usual:.2f} is usual"
                return Fault(FaultKind.MISFIT, text)
            self.restart()
            return None
        self._wrong = 0
        self._judged += 1
        self.usual = self.share if self.usual is None else self.usual + USUAL * (self.share - self.usual)
        return None
