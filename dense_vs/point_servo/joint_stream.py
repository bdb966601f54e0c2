"""A live robot's joints on the camera's clock: readings judged, kept, and interpolated to the images' stamps.

A joint that moves by another share than its readings say, as by a slipping belt, is followed by that share: its
position is the reading and all that its belt has slipped.
"""

import numpy as np

from dense_vs.health.faults import Fault, FaultKind
from dense_vs.health.gain_check import APART, GainCheck
from dense_vs.health.joint_watch import JointWatch
from dense_vs.health.motion_check import Motion, MotionCheck
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.point_servo.delay_trial import DelayTrial
from dense_vs.recording.joint_delay import (
    DelayCurve,
    babbling_curve,
    find_changed_delay,
    find_joint_delay,
    find_jumped_delay,
)
from dense_vs.recording.joint_log import JointBuffer
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Robot
from dense_vs.robot.stamped import read_joints

DELAY_MOTIONS = 60  # of babbling, that the delay of joint readings is found in at a time
DELAY_TRIES, AGAIN_AFTER = 6, 45  # times that it is sought, and motions between
LEAST_CHANGE = 0.1  # frames that a later time has to change it by
DELAY_MARGIN = 3  # frames more of readings, as the longest delay that is tried
READINGS = 8192  # that are kept: 16 s of them at 500 Hz
DELAY_STEP = 8  # px between the pixels that it is found from


class JointStream:
    """Readings of a robot's joints.

    Args:
        robot: gives them.
        group: the n joints in use.
        watch: judges them.
        delay: time that readings are behind the images [s]; None to find it.

    Attributes:
        delay: as far as is known [s].
        finding: whether it is still sought.
        gains: ``(n,)``, what the joints move by for each unit of their readings; 1 where nothing is wrong.
        slipped: ``(n,)``, what the joints have moved beside their readings [rad, m].
    """

    def __init__(self, robot: Robot, group: JointGroup, watch: JointWatch, delay: float | None):
        self._robot, self._group, self.watch = robot, group, watch
        self.finding = delay is None
        self.delay = 0.0 if delay is None else delay
        self._sought = 0  # times
        self._curves: list[DelayCurve] = []  # of the babbling so far
        self._curve_frame = 0.0  # time between images that they are of [s]
        self.gains, self.slipped = np.ones(len(group.names)), np.zeros(len(group.names))
        self._gain_check = GainCheck(len(group.names))
        self.restart()

    def restart(self) -> None:
        """Forget earlier readings, as after a gap."""
        self.watch.restart()
        self._forget()

    def _forget(self) -> None:
        """What was known by earlier readings; how they are judged stays."""
        self._buffer = JointBuffer(len(self._group.names), READINGS)
        self._motion: list[tuple[float, float, np.ndarray]] = []  # stamps of two images and the flow between them
        self._begin: float | None = None  # stamp of the image that the next flow begins at
        self._trial: DelayTrial | None = None
        self._gain_check.restart()

    def read(self, image_time: float) -> tuple[Fault, ...]:
        """Take the robot's newest reading, if it can be believed; what is wrong with it.

        Raises:
            DenseVSError: as :meth:`JointWatch.judge`.
        """
        positions, stamp = read_joints(self._robot)
        reading = np.asarray(self._group.take(positions), dtype=np.float64)
        before = self.watch.positions
        faults = self.watch.judge(reading, stamp, image_time)
        if not any(fault.stops for fault in faults):
            if before is not None:
                self.slipped += (self.gains - 1) * (reading - before)
            if not self._buffer.continues(stamp):  # none was believed for so long that where joints were is not known
                self._forget()
            self._buffer.add(reading + self.slipped, stamp)
        slips = (self._slips(int(joint)) for joint in np.flatnonzero(self.gains != 1))
        return (*faults, *slips)

    @property
    def reading(self) -> np.ndarray:
        """The last reading that was believed, ``(n,)`` [rad]."""
        assert self.watch.positions is not None  # one is read before anything is asked
        return self.watch.positions

    @property
    def newest(self) -> np.ndarray:
        """Where the joints are by the last reading that was believed, ``(n,)`` [rad]."""
        return self.reading + self.slipped

    @property
    def newest_time(self) -> float:
        """Its stamp [s]."""
        return self.watch.time

    def at(self, image_time: float) -> np.ndarray:
        """Where the joints were at an image's time, as far as is known by now, ``(n,)`` [rad]."""
        return self._buffer.at(image_time + self.delay)

    def kept_at(self, image_time: float) -> np.ndarray | None:
        """The same of an image that may be long past; None where its readings are no longer kept."""
        return self.at(image_time) if image_time + self.delay >= self._buffer.first_time - 1e-6 else None

    def has(self, image_time: float) -> bool:
        """Whether the readings of an image's time are there."""
        return image_time + self.delay <= self._buffer.last_time + 1e-6  # s; stamps are rounded sums

    def find_delay(self, frame: ProcessedFrame) -> float:
        """Note a frame's motion and, whenever there is enough, find the delay; what it changed by just now [s].

        As long as the robot babbles it is found anew, from all motions so far, some seconds long.
        """
        start = DELAY_STEP // 2
        if frame.held:  # the next flow begins where this one would have
            return 0.0
        if frame.flow is not None and self._begin is not None:
            self._motion.append((self._begin, frame.time, frame.flow[start::DELAY_STEP, start::DELAY_STEP]))
        self._begin = frame.time
        motion = self._motion[:DELAY_MOTIONS]
        if len(motion) < DELAY_MOTIONS or not self.has(motion[-1][1] + DELAY_MARGIN * self.watch.frame_time):
            return 0.0
        pairs = np.array([(begin, end) for begin, end, _ in motion])
        flows = np.array([np.nan_to_num(flow).ravel() for *_, flow in motion])
        self._curve_frame = self._curve_frame or float(np.median(pairs[:, 1] - pairs[:, 0]))
        curve = babbling_curve(flows, pairs, *self._buffer.readings(), self._curve_frame)
        self._curves += [] if curve is None else [curve]
        self._motion = self._motion[AGAIN_AFTER:]
        self._sought += 1
        self.finding = self._sought < DELAY_TRIES
        found, before = find_joint_delay(self._curves, self._curve_frame), self.delay
        if found is not None and abs(found - before) >= LEAST_CHANGE * self._curve_frame:
            self.delay = found
        return self.delay - before

    def judge_motion(self, frame: ProcessedFrame, check: MotionCheck) -> tuple[Fault, float] | None:
        """Take out a joint's gain or a delay that has changed, as far as a frame's motion tells it.

        Args:
            frame: the newest.
            check: that has judged it.

        Returns:
            What to say, and the time of the first image that is meant [s]; None where nothing changed.
        """
        newest = check.last if check.last is not None and check.last.end == frame.time else None
        if (slip := self._find_gain(newest)) is not None:
            return slip
        if (decided := self._try(newest)) is not None:
            return decided
        if any(fault.kind is FaultKind.MISFIT for fault in frame.faults):
            return self._find_change(list(check.recent))
        return None

    def _find_gain(self, motion: Motion | None) -> tuple[Fault, float] | None:
        """A joint that moves by another share of its readings than until now, which is taken out of what is kept."""
        if motion is None or not motion.trusted:
            return None
        change = self._gain_check.judge(motion, self.at(motion.end) - self.at(motion.begin), self.gains)
        if change is None:
            return None
        joint, before = change.joint, self.gains[change.joint]
        gain = change.factor * before
        self.gains[joint] = 1.0 if abs(gain - 1) < APART else gain
        newest = self._buffer.at(self._buffer.last_time)
        self._buffer.stretch(joint, self.gains[joint] / before, change.since + self.delay)
        self.slipped += self._buffer.at(self._buffer.last_time) - newest
        self._gain_check.restart()
        return self._slips(joint), change.since

    def _slips(self, joint: int) -> Fault:
        gain = self.gains[joint]
        share = "as its readings say again" if gain == 1 else f"by {gain:.2f} of what its readings say; taken out"
        return Fault(FaultKind.SLIP, f"{self._group.names[joint]} moves {share}", stops=False, holds=False)

    def _find_change(self, recent: list[Motion]) -> tuple[Fault, float] | None:
        """A delay that explains motions which the present one does not."""
        first, *motions = recent  # the first may span the moment at which the delay changed
        frame_time = self.watch.frame_time
        known: dict[str, float] = {"now": self.delay, "frame_time": frame_time}
        if not motions:
            span = first.begin, first.end
            found = find_jumped_delay(first.flow, first.jacobian, span, *self._buffer.readings(), **known)
        else:
            found = find_changed_delay(
                [motion.flow for motion in motions],
                [motion.jacobian for motion in motions],
                np.array([(motion.begin, motion.end) for motion in motions]),
                *self._buffer.readings(),
                **known,
            )
        if found is None or abs(found - self.delay) < 0.4 * frame_time:
            return None
        self._trial = None if motions else DelayTrial(self.delay, found, first.end, frame_time)
        return (self._changed(found), first.end) if motions else None

    def _try(self, motion: Motion | None) -> tuple[Fault, float] | None:
        """To a delay that a single motion told where the next agrees, and back where those after that do not."""
        trial = self._trial
        if trial is None or (better := trial.judge(motion, *self._buffer.readings())) is None:
            return None
        if trial.taken or better == trial.before:
            self._trial = None
        if trial.taken == (better == trial.now):
            return None
        trial.taken = True
        return self._changed(better), trial.since

    def _changed(self, delay: float) -> Fault:
        self.delay = delay
        self._curves, self._motion, self._begin = [], [], None  # of before
        if delay == 0:
            text = "images come when their stamps say again"
        elif delay < 0:
            text = f"images come {-delay:.3f} s later than their stamps say; taken out"
        else:
            text = f"joint readings are {delay:.3f} s behind the images now; taken out"
        return Fault(FaultKind.LATE, text, stops=False, holds=False)
