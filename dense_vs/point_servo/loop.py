"""The closed loop on a robot: babble until J is learned, then bring a point of the body to image targets."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import numpy as np

from dense_vs.arrays import point_array
from dense_vs.body.self_body import SelfBody
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import BODY_FLOW, Frame, FramePipeline
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.link_tracker import LinkTracker
from dense_vs.point_servo.tracker import Method, PointTracker
from dense_vs.recording.joint_delay import joint_delay as found_joint_delay
from dense_vs.recording.joint_log import JointBuffer
from dense_vs.robot.babbling import Babbling
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Robot

LEAST_BODY = 0.01  # share of the image that makes the robot's own pixels count as known
LEARNT_UPDATES = 30  # after which the babbling's pace comes from J dq
DELAY_FRAMES = 60  # of babbling, that the delay of joint readings is found in
DELAY_MARGIN = 3  # frames more of readings, as the longest delay that is tried
DELAY_STEP = 8  # px between the pixels that it is found from
MOST_HELD = 30  # images that wait for their joint readings; a robot whose readings stop is not waited for
HISTORY = 150  # images that J was corrected by, in which the point's link is looked for
OWN_JOINT = 0.05  # of the largest column of J at a point: a joint with less does not move it
SAME_SURFACE = 0.5  # relative difference in J below which two pixels count as one surface


class ReachEnd(Enum):
    """How a reach ended."""

    PENDING = "pending"
    """Not over yet; only in a batch that is still running."""
    REACHED = "reached"
    """The point stayed within the tolerance of its target."""
    MISSED = "missed"
    """The frames were used up."""
    LOST = "lost"
    """The tracker lost the point."""


@dataclass(frozen=True)
class Reach:
    """One reach.

    Attributes:
        target: x, y [px].
        frames: frames it took.
        error_px: distance of the tracked point from the target at the end.
        end: how it ended.
    """

    target: tuple[float, float]
    frames: int
    error_px: float
    end: ReachEnd

    @property
    def reached(self) -> bool:
        """Whether the point stayed within the tolerance."""
        return self.end is ReachEnd.REACHED

    @property
    def lost(self) -> bool:
        """Whether the tracker had lost the point at the end."""
        return self.end is ReachEnd.LOST


class ServoLoop:
    """Runs camera, flow, estimator, tracker and servo, a frame at a time.

    Args:
        camera, robot: of one robot, on one clock.
        joints: names of the N joints to use, in this order; the others get no command. All unless given.
        estimator: for the camera's images once scaled and the N joints; made to fit unless given.
        servo: the control law; made with the joints' limits unless given.
        flow: of the estimator's size; the default method unless given.
        babbling: the motion before J is known; the default unless given.
        scale: factor on the image size.
        threads: CPU threads of an estimator made here.
        device: of an estimator made here.
        seed: of babbling and dither made here.
        command_period: time between commands [s], for a robot that takes a new one only so often; in the frames between
            them J is learned and the commanded step is zero. A command every frame unless given.
        body: labels the robot's own pixels, see :meth:`FramePipeline.labels`; once it knows some, what else moves no
            longer slows the babbling down.
        renew_patch: correlation below which the patch of a point that is followed as "aligned" is taken anew as it
            looks now, where it still aligns. A surface that rotates in depth is lost otherwise; every renewal may add
            some hundredths of a pixel of drift. The first patch is kept unless given.
        joint_delay: time that joint readings are behind the images [s], below 0 where the images are late. Unless given
            it is found in the first 2 s of babbling; where there is one, learning begins anew, and an image waits until
            the readings of its time are there.
        on_frame: called with the loop after every frame; a viewer, a recorder, an evaluation.

    Raises:
        DenseVSError: parts that do not fit each other.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        *,
        joints: Sequence[str] | None = None,
        estimator: DenseJacobian | None = None,
        servo: VisualServo | None = None,
        flow: FlowEstimator | None = None,
        babbling: Babbling | None = None,
        scale: float = 1.0,
        device: str = "auto",
        threads: int | None = None,
        seed: int = 0,
        command_period: float | None = None,
        body: SelfBody | None = None,
        renew_patch: float | None = None,
        joint_delay: float | None = None,
        on_frame: Callable[["ServoLoop"], None] | None = None,
    ):
        self.camera, self.robot = camera, robot
        self.group = JointGroup.of_robot(robot, joints)
        count = len(self.group.names)
        image, time = camera.read()
        if estimator is None:
            height, width = (round(side * scale) for side in np.asarray(image).shape[:2])
            estimator = DenseJacobian(
                height=height, width=width, joints=count, device=device, threads=threads, on_bad_flow="skip"
            )
        if estimator.options.joints != count:
            raise DenseVSError(
                f"estimator has {estimator.options.joints} joints; expected {count}: {', '.join(self.group.names)}"
            )
        self.estimator = estimator
        self.servo = servo or VisualServo(count, joint_limits=self.group.limits, seed=seed)
        self.renew_patch = None if renew_patch is None else check_number("renew_patch", renew_patch, above=0, below=1)
        self.command_period = (
            None if command_period is None else check_number("command_period", command_period, above=0)
        )
        pace = {} if command_period is None else {"frame_time": command_period}
        self.babbling = babbling or Babbling(count, seed=seed, **pace)
        self._next_command = time
        self.pipeline = FramePipeline(estimator, flow, scale=scale, body=body)
        # Sharper at outlines than J's flow needs to be: a point near one would be carried off with the background.
        size = estimator.options.height, estimator.options.width
        shared = self.pipeline.flow.method == BODY_FLOW
        self._tracking_flow = self.pipeline.flow if shared else FlowEstimator(BODY_FLOW, *size)
        self.tracker: PointTracker | LinkTracker | None = None
        self._history: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=HISTORY)
        self.target: np.ndarray | None = None
        self.on_frame = on_frame
        self._finding_delay = joint_delay is None
        self.joint_delay = 0.0 if joint_delay is None else check_number("joint_delay", joint_delay)
        self._motion: list[tuple[float, np.ndarray | None]] = []  # time and flow of the frames it is found from
        self._buffer = JointBuffer(count)
        self._held: deque[tuple[np.ndarray, float]] = deque()  # images whose joint readings are still to come
        self._frame = self.pipeline.process(image, time, self._reading(time))

    @property
    def frame(self) -> Frame:
        """The last frame; with late joint readings, the last one that they have reached."""
        return self._frame

    @property
    def point(self) -> np.ndarray:
        """Where the tracked point is, ``(2,)`` [px].

        Raises:
            DenseVSError: none is defined yet.
        """
        if self.tracker is None:
            raise DenseVSError("no point is defined; expected define_point() first")
        return self.tracker.points[0]

    def step(self, delta: np.ndarray) -> Frame:
        """Command a joint step ``(N,)`` [rad], then take the next image through estimator and tracker."""
        self.robot.command(self.group.spread(delta))
        last = self._frame
        frame = self._take(*self.camera.read())
        if self.tracker is not None and frame is not last:
            self._track(last, frame)
        if frame is not last and frame.measured is not None:
            self._history.append((frame.gray, frame.positions))
        if self.on_frame is not None:
            self.on_frame(self)
        return frame

    def babble(self, seconds: float) -> None:
        """Move at random for that long on the camera's clock, learning J."""
        if not np.isfinite(seconds) or seconds <= 0:
            raise DenseVSError(f"babbling of {seconds!r} s; expected a finite number above 0")
        end = self.frame.time + seconds
        while self.frame.time < end:
            self.step(self._when_due(self._babbling_step))
            if self._finding_delay:
                self._find_delay()
        while self._held:  # let what is known catch up with where the robot is
            before = len(self._held)
            self.step(np.zeros(self.estimator.options.joints))
            if len(self._held) >= before:
                break

    def define_point(
        self,
        point: Any,
        *,
        method: Method | Literal["link"] = "link",
        window: int = 25,
        min_correlation: float = 0.85,
        max_jump: float = 2.5,
        lost_after: int = 15,
    ) -> None:
        """Choose the point of the body to control, at its place in the last image [px].

        Pixels whose J differs from the point's by more than half are left out of its alignment:
        they move otherwise, so they are another body or the background.

        Args:
            point: ``(2,)`` [px].
            method: ``"link"``, by the motion of its whole link, see :class:`LinkTracker`, where the images so far
                show such a link, else as ``"aligned"``; or one of :class:`PointTracker`.
            window, lost_after, min_correlation, max_jump: see :class:`PointTracker`.
        """
        if method == "link":
            method = "aligned"
            link = self._link_tracker(point_array(point, "point"), window, lost_after)
        else:
            link = None
        self.tracker = PointTracker(
            point,
            self.frame.gray,
            weights=self._same_surface(point),
            method=method,
            window=window,
            min_correlation=min_correlation,
            max_jump=max_jump,
            lost_after=lost_after,
        )
        if link is not None:
            self.tracker = link

    def reach(self, target: Any, *, tolerance: float = 1.0, settle_frames: int = 5, max_frames: int = 150) -> Reach:
        """Servo the defined point to a target by DIJE (17).

        Stops when the tracker has lost the point. One that is followed by its link is sought on, and counts as reached
        only where what is seen of the link agrees on its place.

        Args:
            target: ``(2,)`` [px].
            tolerance: distance that counts as there [px].
            settle_frames: frames it has to stay there.
            max_frames: frames after which it gives up.

        Raises:
            DenseVSError: no point defined, or a target that is not two finite numbers.
        """
        self.target = point_array(target, "target")
        settled = frames = 0
        distance = float(np.hypot(*(self.point - self.target)))
        while frames < max_frames and not (settled >= settle_frames and self._certain) and not self._given_up:
            self.step(self._when_due(self._servo_step))
            frames += 1
            distance = float(np.hypot(*(self.point - self.target)))
            settled = settled + 1 if distance <= tolerance else 0
        end = ReachEnd.REACHED if settled >= settle_frames else ReachEnd.MISSED
        goal = float(self.target[0]), float(self.target[1])
        return Reach(goal, frames, distance, end if self._certain else ReachEnd.LOST)

    def _pacing_flow(self) -> np.ndarray | None:
        """The last frame's image motion: J dq once J is learnt, which neither noise nor others' motion slows down.

        Without what is known not to be the robot, once the robot itself is known.
        """
        frame, body = self.frame, self.pipeline.body
        if frame.dq is None:
            return None
        learnt = self.estimator.updates > LEARNT_UPDATES
        flow = self.estimator.predicted_flow(frame.dq) if learnt else frame.flow
        if flow is None or body is None:
            return flow
        found = body.recognition(self.estimator.jacobian)
        if np.mean(found == 1) < LEAST_BODY:
            return flow
        return np.where((found == 0)[..., None], np.float32(np.nan), flow)

    def _babbling_step(self) -> np.ndarray:
        return self.group.clip_step(self.babbling.step(self._pacing_flow()), self.frame.positions)

    def _servo_step(self) -> np.ndarray:
        J = self.estimator.at(self.point)[0]  # DIJE (16)
        return self.servo(J, self.point, self.target, self.frame.positions)

    def _when_due(self, choose: Callable[[], np.ndarray]) -> np.ndarray:
        """The chosen joint step where a command is due by now, else zero."""
        if self.command_period is None:
            return choose()
        late = self.frame.time - self._next_command
        if late < -1e-6:  # s; stamps are sums of rounded numbers
            return np.zeros(self.estimator.options.joints)
        # On a grid, which restarts after a pause.
        self._next_command += self.command_period * (
            1 if late < self.command_period else late // self.command_period + 1
        )
        return choose()

    def _renew_patch(self, tracker: PointTracker) -> None:
        if self.renew_patch is None or tracker.lost[0]:
            return
        # Not where it does not align: something else may cover it.
        if tracker.options.min_correlation <= float(tracker.correlation[0]) < self.renew_patch:
            tracker.redefine(tracker.points, self.frame.gray, self._same_surface(tracker.points[0]))

    def _same_surface(self, point: Any) -> np.ndarray | None:
        """(H, W) bool: pixels that move as the point does; None where J says nothing yet."""
        unlikeness = self._unlikeness(point)
        return None if unlikeness is None else unlikeness <= SAME_SURFACE

    def _unlikeness(self, point: Any) -> np.ndarray | None:
        """(H, W) difference of every J from the point's, relative to the point's; None where J says nothing yet."""
        own = self.estimator.at(point)[0]
        size = np.linalg.norm(own)
        if size == 0:
            return None
        return np.linalg.norm(self.estimator.to_numpy() - own, axis=(2, 3)) / size

    def _track(self, last: Frame, frame: Frame) -> None:
        """Follow the point into the last frame."""
        if isinstance(self.tracker, LinkTracker):
            self.tracker.update(frame.gray, frame.positions, lambda: self._unlikeness(self.point))
        elif self.tracker is not None:
            self.tracker.update(self._tracking_flow(last.gray, frame.gray), frame.gray)
            self._renew_patch(self.tracker)

    def _link_tracker(self, point: np.ndarray, window: int, lost_after: int) -> LinkTracker | None:
        """A tracker by the point's whole link, where the images so far tell how it moves."""
        frame, history = self.frame, list(self._history)
        if not history or history[-1][0] is not frame.gray:
            history.append((frame.gray, frame.positions))
        unlikeness = self._unlikeness(point)
        if unlikeness is None:
            return None
        moves = np.linalg.norm(self.estimator.at(point)[0], axis=0)
        joints = moves > OWN_JOINT * moves.max()
        tracker = LinkTracker(history, point, unlikeness, joints=joints, window=window, lost_after=lost_after)
        return None if tracker.motion is None else tracker

    @property
    def _certain(self) -> bool:
        """Whether it is known where the point is."""
        return self.tracker.certain if isinstance(self.tracker, LinkTracker) else not self._given_up

    @property
    def _given_up(self) -> bool:
        """Whether the point is lost and not sought."""
        return isinstance(self.tracker, PointTracker) and bool(self.tracker.lost[0])

    def _take(self, image: np.ndarray, time: float) -> Frame:
        """The last frame that this image lets be processed: itself, or an earlier one that waited for its readings."""
        positions = self._reading(time)
        if self.joint_delay <= 0:
            self._frame = self.pipeline.process(image, time, positions)
            return self._frame
        self._held.append((np.array(image), time))  # a camera may reuse its buffer
        while self._held and (self._is_read(self._held[0][1]) or len(self._held) > MOST_HELD):
            image, time = self._held.popleft()
            self._frame = self.pipeline.process(image, time, self._buffer.at(time + self.joint_delay))
        return self._frame

    def _reading(self, time: float) -> np.ndarray:
        """Take the robot's newest reading; where the joints were at an image's time, as far as is known by now."""
        positions, stamp = self.robot.joints()
        self._buffer.add(self.group.take(positions), stamp)
        return self._buffer.at(time + self.joint_delay)

    def _is_read(self, time: float) -> bool:
        return time + self.joint_delay <= self._buffer.readings()[0][-1] + 1e-6  # s; stamps are sums of rounded numbers

    def _find_delay(self) -> None:
        """Note the last frame's motion; once there is enough, find the delay and begin anew where there is one."""
        flow, start = self._frame.flow, DELAY_STEP // 2
        self._motion.append((self._frame.time, None if flow is None else flow[start::DELAY_STEP, start::DELAY_STEP]))
        if len(self._motion) < DELAY_FRAMES + DELAY_MARGIN:
            return
        self._finding_delay = False
        seen = self._motion[:DELAY_FRAMES]
        times = np.array([time for time, _ in seen])
        flows = np.array([np.nan_to_num(flow).ravel() for _, flow in seen[1:] if flow is not None])
        self._motion = []
        self.joint_delay = found_joint_delay(flows, times, *self._buffer.readings())
        if self.joint_delay:
            self.pipeline.restart(forget=True)
            self._history.clear()
