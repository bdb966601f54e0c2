"""Whether a joint reading can be believed: its stamp by the camera's clock, its step by what motors can do, and whether
it follows what was commanded.
"""

import statistics
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_names, check_number
from dense_vs.errors import DenseVSError
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.robot.per_joint import per_joint, stamp_of

MOST_APART = 1.0  # s between the stamps of an image and of the joints at the start
LEAST_SHIFT = 0.2  # s, change of that difference that no transport of images makes
SHIFT_FRAMES = 2.5  # the same in frames
FASTER = 2.0  # times the largest command that a joint may move a frame
LAGGING = 0.15  # of the largest command: commanded way without a change of the reading that is looked into
NOT_FOLLOWED = 0.25  # the same, that counts
FOLLOWS = 0.1  # share of the commanded way that a reading has to change by
FREED = 0.05  # of the largest command: change of a stuck joint's reading
STUCK_SECONDS = 0.5
RETRY_SECONDS = 2.0  # after which a stuck joint is tried again
USUAL_FRAMES = 31


class JointWatch:
    """Judges the readings of n joints, one a frame.

    Args:
        names: of the joints.
        max_step: ``(n,)`` or a number, largest command [rad, m].
        max_speed: ``(n,)`` or a number, above which no motor moves its joint [rad/s, m/s]; twice the largest command a
            frame unless given.

    Attributes:
        positions: ``(n,)``, the last reading that was believed; None before the first.
        time: its stamp [s].
        stuck: ``(n,)`` bool, joints that do not follow; they are to get no commands.
        changed: whether the last reading made or ended a stuck joint: its step is no motion.

    Raises:
        DenseVSError: no names, or bounds that are not finite numbers above 0.
    """

    def __init__(self, names: Sequence[str], max_step: Any, max_speed: Any = None):
        self._names = check_names("joint names", names)
        count = len(self._names)
        self._max_step = per_joint("max_step", max_step, count)
        self._max_speed = None if max_speed is None else per_joint("max_speed", max_speed, count)
        self.restart()

    def restart(self) -> None:
        """Take the next reading as it is, as after a gap."""
        count = len(self._names)
        self.positions: np.ndarray | None = None
        self.time = -np.inf
        self.changed = self._doubted = False
        self.stuck = np.zeros(count, dtype=bool)
        self._offsets: deque[float] = deque(maxlen=USUAL_FRAMES)
        self._frames: deque[float] = deque(maxlen=USUAL_FRAMES)
        self._last_image: float | None = None
        self._unchanged = np.zeros(count)  # readings from which on they have not changed
        self._since = np.zeros(count)  # when that was [s]
        self._commanded = np.zeros(count)  # way commanded since
        self._farthest = np.zeros(count)  # its largest length
        self._released = np.full(count, -np.inf)  # when a stuck joint is to be tried again

    def commanded(self, step: np.ndarray) -> None:
        """Note a step ``(n,)`` that was sent.

        Raises:
            DenseVSError: not n finite numbers.
        """
        step = number_array(step, "step", (len(self._names),))
        if self._doubted:
            return  # what the joint does is not known until a reading is believed
        self._commanded += step
        self._farthest = np.maximum(self._farthest, np.abs(self._commanded))

    def judge(self, positions: np.ndarray, stamp: float, image_time: float) -> list[Fault]:
        """What is wrong with a reading that came with an image; it is believed where no fault says otherwise.

        Args:
            positions: ``(n,)`` [rad, m].
            stamp: of the reading [s].
            image_time: stamp of the image [s].

        Raises:
            DenseVSError: no numbers or another shape, a stamp that is no number, the image's that is not finite; for
                the first reading, positions that are not finite, or a stamp that cannot be on the camera's clock.
        """
        first = self.positions is None
        q = number_array(positions, "joint positions", (len(self._names),), finite=first)
        stamp, image_time = stamp_of("joint stamp", stamp), check_number("image time stamp", image_time)
        if first:
            self._begin(q, stamp, image_time)
            return []
        self.changed = False
        if self._last_image is not None and image_time > self._last_image:
            self._frames.append(image_time - self._last_image)
        self._last_image = image_time
        fault = self._wrong_stamp(stamp, image_time) or self._wrong_step(q, stamp)
        self._doubted = fault is not None
        if fault is not None:
            return [fault]
        self._offsets.append(image_time - stamp)
        self.positions, self.time = q.copy(), max(stamp, self.time)
        return self._follow(q, image_time)

    @property
    def frame_time(self) -> float:
        """Usual time between images [s]."""
        return statistics.median(self._frames) if self._frames else 1 / 30

    def _begin(self, q: np.ndarray, stamp: float, image_time: float) -> None:
        if not np.isfinite(stamp) or abs(image_time - stamp) > MOST_APART:
            raise DenseVSError(
                f"joint stamp is {stamp} s with an image of {image_time} s; expected one clock for joints and camera, "
                f"and stamps at most {MOST_APART:g} s apart"
            )
        self.positions, self.time, self._last_image = q.copy(), stamp, image_time
        self._offsets.append(image_time - stamp)
        self._unchanged[:], self._since[:] = q, image_time

    def _wrong_stamp(self, stamp: float, image_time: float) -> Fault | None:
        if not np.isfinite(stamp):
            return Fault(FaultKind.CLOCK, f"joint stamp is {stamp}")
        usual = statistics.median(self._offsets)
        shift = image_time - stamp - usual
        if abs(shift) > max(LEAST_SHIFT, SHIFT_FRAMES * self.frame_time):
            text = (
                f"joint stamp {stamp:.3f} s is {abs(shift):.3f} s {'behind' if shift > 0 else 'ahead of'} the camera's"
            )
            return Fault(FaultKind.CLOCK, f"{text} clock")
        if stamp < self.time:
            return Fault(FaultKind.CLOCK, f"joint stamp {stamp:.3f} s is before that of the last reading")
        return None

    def _wrong_step(self, q: np.ndarray, stamp: float) -> Fault | None:
        assert self.positions is not None
        if not np.isfinite(q).all():
            return Fault(FaultKind.READING, f"joint reading is {q.tolist()}")
        frames = max((stamp - self.time) / self.frame_time, 1.0)
        # A reading that was stuck comes back by as much as was commanded meanwhile.
        fastest = FASTER * self._max_step if self._max_speed is None else self._max_speed * self.frame_time
        most = fastest * min(frames, 3.0) + self._farthest
        over = np.abs(q - self.positions) - most
        if (over <= 0).all():
            return None
        joint = int(np.argmax(over))
        change = q[joint] - self.positions[joint]
        text = f"{self._names[joint]} changed by {change:.3g} in one reading; at most {most[joint]:.3g} can be"
        return Fault(FaultKind.READING, text)

    def _follow(self, q: np.ndarray, now: float) -> list[Fault]:
        """Joints that were commanded to move and whose readings stay."""
        away = np.abs(q - self._unchanged)
        # One that is stuck gets no commands: any motion says that it is free.
        moved = away > np.where(self.stuck, FREED * self._max_step, np.maximum(FOLLOWS * self._farthest, 1e-9))
        self.changed = bool((moved & self.stuck).any())
        self.stuck &= ~moved
        self._unchanged = np.where(moved, q, self._unchanged)
        self._since = np.where(moved, now, self._since)
        self._commanded[moved] = self._farthest[moved] = 0.0
        retry = self.stuck & (now >= self._released)
        self.stuck &= ~retry
        self._since[retry], self._commanded[retry], self._farthest[retry] = now, 0.0, 0.0
        long = now - self._since
        stuck = ~self.stuck & (self._farthest > NOT_FOLLOWED * self._max_step) & (long >= STUCK_SECONDS)
        self.changed |= bool(stuck.any())
        self.stuck |= stuck
        self._released[stuck] = now + RETRY_SECONDS
        lagging = (self._farthest > LAGGING * self._max_step) & (long > 1.5 * self.frame_time) & ~self.stuck
        faults = []
        for joint in np.flatnonzero(self.stuck):
            text = f"{self._names[joint]} stays at {q[joint]:.4g} although it was commanded to move; it is left out"
            faults.append(Fault(FaultKind.STUCK, text, stops=False, holds=self.changed))
        for joint in np.flatnonzero(lagging):
            text = f"{self._names[joint]} has not followed its commands for {long[joint]:.2f} s"
            faults.append(Fault(FaultKind.STUCK, text, stops=False))
        return faults
