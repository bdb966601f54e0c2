"""A delay that one motion told is on trial: the motions that follow decide between it and the delay before.

One motion that J explains badly can look like an image of another time by chance. So the delay is not taken out before
the next motion has been asked, as J is unlearned by joint steps of another time: where that one speaks for the delay
before, it was chance. If it was chance nonetheless, the motions after it agree with the delay before; where motion is
so even that both explain it alike, they go on being compared. One motion tells a delay to about a frame; those that
decide for it tell it anew.
"""

from dataclasses import replace

import numpy as np

from dense_vs.health.motion_check import MOVING, Motion
from dense_vs.recording.joint_delay import (
    FRAME_SHARE,
    LEAST_CHANGED,
    LEAST_FRAMES,
    DelayCurve,
    joint_steps,
    unexplained_by_jacobian,
)

LEAST_MOTIONS = 8  # that decide
MOST_MOTIONS = 60  # after which the better of the two stays
CLEAR = 0.7  # of what the other leaves unexplained
NEAR = 2.0  # frames beside the delay on trial in which it is told anew


class DelayTrial:
    """Compares a delay with the one before it.

    Args:
        before: delay until then [s].
        now: delay on trial [s].
        since: time of the image that told it [s].
        frame_time: time between images [s].

    Attributes:
        taken: whether the delay on trial has been taken out.
    """

    def __init__(self, before: float, now: float, since: float, frame_time: float):
        self.before, self.now, self.since = before, now, since
        self.taken = False
        self._frame_time = frame_time
        steps = round(NEAR / FRAME_SHARE)
        self._near = now + np.arange(-steps, steps + 1) * (FRAME_SHARE * frame_time)
        self._waiting: list[Motion] = []  # for their readings
        self._left: list[np.ndarray] = []  # shares that either leaves unexplained, (2,) each
        self._moving: list[Motion] = []  # that they are of, at places that move

    def judge(self, motion: Motion | None, times: np.ndarray, positions: np.ndarray) -> float | None:
        """The delay that explains the motions since better [s]; None until that is known.

        Until the delay on trial is taken, one motion decides, and has to speak clearly to be against it. Motions that
        decide for it then may tell one beside it.

        Args:
            motion: of the newest image; None where there is none.
            times: ``(S,)`` stamps of the joint readings [s], increasing.
            positions: ``(S, N)`` the readings [rad, m].
        """
        if motion is not None and motion.begin >= self.since:
            self._waiting.append(motion)
        delays = np.array([self.before, self.now])
        while self._waiting and self._waiting[0].end + delays.max() <= times[-1] + 1e-6:
            self._compare(self._waiting.pop(0), delays, times, positions)
        if len(self._left) < (LEAST_MOTIONS if self.taken else 1):
            return None
        before, now = np.mean(self._left, axis=0)
        if not self.taken:
            return self.before if before < CLEAR * now else self.now
        if len(self._left) < MOST_MOTIONS and min(before, now) > CLEAR * max(before, now):
            return None
        return self.before if before < now else self._told_anew(times, positions)

    def _told_anew(self, times: np.ndarray, positions: np.ndarray) -> float:
        """The delay on trial, or one beside it that leaves less unexplained; none where that is nearly none."""
        known = [motion for motion in self._moving if motion.end + self._near[-1] <= times[-1] + 1e-6]
        if len(known) < LEAST_MOTIONS // 2:
            return self.now
        steps = joint_steps(np.array([(motion.begin, motion.end) for motion in known]), self._near, times, positions)
        left = unexplained_by_jacobian(steps, [motion.flow for motion in known], [motion.jacobian for motion in known])
        best = DelayCurve(self._near, left).best
        if abs(best - self.now) < LEAST_FRAMES * self._frame_time:
            return self.now
        return best if abs(best) >= LEAST_CHANGED * self._frame_time else 0.0

    def _compare(self, motion: Motion, delays: np.ndarray, times: np.ndarray, positions: np.ndarray) -> None:
        steps = joint_steps(np.array([[motion.begin, motion.end]]), delays, times, positions)
        predicted = np.linalg.norm(motion.jacobian @ steps[:, 0].T, axis=1)  # (K, 2)
        moving = np.maximum(np.linalg.norm(motion.flow, axis=1), predicted.max(axis=1)) > MOVING
        if moving.any():
            part = replace(motion, flow=motion.flow[moving], jacobian=motion.jacobian[moving])
            self._left.append(unexplained_by_jacobian(steps, [part.flow], [part.jacobian]))
            self._moving.append(part)
