"""Whether the image moved as the joints say, by the innovation u - J dq of a whole image.

At places on the robot the share |u - J s|^2 / (|u|^2 + |J s|^2) is near 0 where flow u and joint step s belong
together, 1 where one of them is missing or the two are strangers. Its median over the places is compared with what is
usual for this robot, so that a J that is known badly is no reason to stop learning it. Nor is a motion in joint
directions that J has not seen for long: by its own covariance the filter says how far off J s may be. Nor is J that
stays behind on a background that the robot has left: places that stand still count only where hardly any place moves.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from dense_vs.arrays import quantile
from dense_vs.health.faults import Fault, FaultKind

MOVING = 1.0  # px of flow or J s: places that move less say nothing
ON_ROBOT = 0.2  # of the largest |J| on the image: places with less are not looked at
LEAST_PLACES = 12
SEEN_MOVING = 0.2  # of the places: where so many move in the image, the others do not count
KNOWN = 60  # judgments until it is known what is usual
TRUSTED = 0.15  # usual share above which J is known too badly to judge by
LEAST_SHARE = 0.5  # that counts where J has to follow the robot to new postures
BABBLING_SHARE = 0.2  # the same about a posture where J has been learned
LEFT_OUT_SHARE = 0.3  # at least, of what is left out: below, J may not be known yet in that direction, and learns it
TIMES_USUAL = 4.0
UNKNOWN = 60.0  # times the share that the filter lets expect, whose variances are to a noise of the flow as it is set
USUAL = 0.05  # weight of the newest judgment
GIVEN_UP = 60  # judgments since the first that was wrong, after which the robot or the camera has changed
KEPT = 16  # motions since they began not to be explained, for finding a delay
SOUND = 6  # motions in a row that are explained, after which it is believed that nothing is wrong any more
MOST_PLACES = 200  # of each


@dataclass(frozen=True)
class Motion:
    """An image's motion against J.

    Attributes:
        begin, end: stamps of the two images [s].
        flow: ``(K, 2)`` [px].
        jacobian: ``(K, 2, N)`` there [px/rad].
        trusted: whether J was known well enough to judge by.
    """

    begin: float
    end: float
    flow: np.ndarray
    jacobian: np.ndarray
    trusted: bool = False


class MotionCheck:
    """Judges flow against J, an image at a time.

    Attributes:
        least_share: share that counts, above what is usual.
        usual: share that is usual; None before the first judgment.
        recent: motions since they began not to be explained.
        last: the motion judged last; None before one.
    """

    def __init__(self) -> None:
        self.least_share = LEAST_SHARE
        self.restart()

    def restart(self) -> None:
        """Forget what is usual, as after J was forgotten."""
        self.share = float("nan")
        self.usual: float | None = None
        self._judged = 0
        self.recent: deque[Motion] = deque(maxlen=KEPT)
        self.last: Motion | None = None
        self.forget_doubt()

    def forget_doubt(self) -> None:
        """Begin to judge anew, by what is usual, as after a delay was taken out."""
        self.recent.clear()
        self._since = self._sound = self._wrong = 0
        self._grave = False  # whether it is more than J that is known too little

    def judge(
        self,
        flow: np.ndarray,
        jacobian: np.ndarray,
        span: np.ndarray,
        begin: float = 0.0,
        end: float = 0.0,
        variance: float = 0.0,
    ) -> Fault | None:
        """What is wrong with an image's motion, where something is.

        Args:
            flow: ``(K, 2)`` at K places [px].
            jacobian: ``(K, 2, N)`` there [px/rad].
            span: ``(N,)`` joint displacement that the flow spans [rad].
            begin, end: stamps of the two images [s].
            variance: of a component of J s, by what is not known of J [px^2].
        """
        size = np.sqrt(np.einsum("kij,kij->k", jacobian, jacobian))
        predicted = jacobian @ span
        of_flow, of_robot = (np.einsum("ki,ki->k", motion, motion) for motion in (flow, predicted))
        energy = of_flow + of_robot
        moving = np.maximum(of_flow, of_robot) > MOVING**2
        on_robot = (size > ON_ROBOT * size.max(initial=0.0)) & np.isfinite(energy)
        robot = np.flatnonzero(on_robot)
        some = robot[:: max(1, len(robot) // MOST_PLACES)]
        known = self.usual is not None and self._judged >= KNOWN and self.usual < TRUSTED
        self.last = motion = Motion(begin, end, flow[some], jacobian[some], known)
        if self.recent:
            self.recent.append(motion)
        chosen = on_robot & moving
        if np.count_nonzero(chosen) < LEAST_PLACES:
            return None
        seen = chosen & (of_flow > MOVING**2)
        if np.count_nonzero(seen) >= max(LEAST_PLACES, SEEN_MOVING * np.count_nonzero(chosen)):
            chosen = seen
        error = ((flow[chosen] - predicted[chosen]) ** 2).sum(axis=1)
        self.share = quantile(error / energy[chosen], 0.5)
        plain = np.inf if self.usual is None else max(self.least_share, TIMES_USUAL * self.usual)
        unknown = UNKNOWN * 2 * variance / quantile(energy[chosen], 0.5)
        wrong = known and self.share > max(plain, unknown)
        if wrong and not self.recent:
            self.recent.append(motion)
        self._grave = self._grave or (wrong and self.share > max(LEFT_OUT_SHARE, unknown))
        if self.recent:
            return self._doubted(wrong)
        self._judged += 1
        if self.usual is None:
            self.usual = self.share
        elif not known or self.share <= plain:  # what is not known yet is not usual
            self.usual += USUAL * (self.share - self.usual)
        return None

    def _doubted(self, wrong: bool) -> Fault | None:
        """After a motion that was not explained: where motion is steady, even one of other images may look right."""
        self._since += 1
        self._sound = 0 if wrong else self._sound + 1
        self._wrong = self._wrong + 1 if wrong else 0
        if self._since >= GIVEN_UP:
            self.restart()
            return None
        if self._sound >= SOUND:
            self.forget_doubt()
            return None
        if not wrong:
            return Fault(FaultKind.MISFIT, "motion was not the joints' a moment ago", stops=False, holds=self._grave)
        text = f"a share of {self.share:.2f} of the motion is not the joints'; {self.usual:.2f} is usual"
        stops = self._grave and self._wrong > 1  # one may be chance
        return Fault(FaultKind.MISFIT, text, stops=stops, holds=self._grave)
