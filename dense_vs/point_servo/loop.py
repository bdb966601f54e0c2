"""The closed loop on a robot: babble until J is learnt, then bring a point of the body to image targets."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.arrays import point_array
from dense_vs.body.self_body import SelfBody
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import Frame, FramePipeline
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.tracker import PointTracker
from dense_vs.recording.joint_log import JointBuffer
from dense_vs.robot.babbling import Babbling
from dense_vs.robot.protocols import Camera, Robot

LEAST_BODY = 0.01  # share of the image that makes the robot's own pixels count as known
SAME_SURFACE = 0.5  # relative difference in J below which two pixels count as one surface


@dataclass(frozen=True)
class Reach:
    """How a reach ended.

    Attributes:
        target: x, y [px].
        frames: frames it took.
        error_px: distance of the tracked point from the target at the end.
        reached: whether it stayed within the tolerance.
        lost: whether the tracker had lost the point at the end.
    """

    target: tuple[float, float]
    frames: int
    error_px: float
    reached: bool
    lost: bool


class ServoLoop:
    """Runs camera, flow, estimator, tracker and servo, a frame at a time.

    Args:
        camera, robot: of one robot, on one clock.
        estimator: for the camera's images once scaled and the robot's joints; made to fit unless given.
        servo: the control law; made with the robot's ``joint_limits``, where it has them, unless given.
        flow: of the estimator's size; the default method unless given.
        babbling: the motion before J is known; the default unless given.
        scale: factor on the image size.
        threads: CPU threads of an estimator made here.
        device: of an estimator made here.
        seed: of babbling and dither made here.
        command_period: time between commands [s], for a robot that takes a new one only so often; in the frames between
            them J is learnt and the commanded step is zero. A command every frame unless given.
        body: labels the robot's own pixels, see :meth:`FramePipeline.labels`; once it knows some, what else moves no
            longer slows the babbling down.
        renew_patch: correlation below which the tracked point's patch is taken anew as it looks now, where it still
            aligns. A surface that turns in depth is lost otherwise; every renewal may add some hundredths of a pixel of
            drift. The patch of the beginning is kept unless given.
        on_frame: called with the loop after every frame; a viewer, a recorder, an evaluation.

    Raises:
        DenseVSError: parts that do not fit each other.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        *,
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
        on_frame: Callable[["ServoLoop"], None] | None = None,
    ):
        self.camera, self.robot = camera, robot
        joints = len(robot.joint_names)
        self.joint_limits = getattr(robot, "joint_limits", None)
        image, time = camera.read()
        if estimator is None:
            height, width = (round(side * scale) for side in np.asarray(image).shape[:2])
            estimator = DenseJacobian(
                height=height, width=width, joints=joints, device=device, threads=threads, on_bad_flow="skip"
            )
        if estimator.options.joints != joints:
            raise DenseVSError(
                f"estimator has {estimator.options.joints} joints; the robot has {joints}: "
                f"{', '.join(robot.joint_names)}"
            )
        self.estimator = estimator
        self.servo = servo or VisualServo(joints, joint_limits=self.joint_limits, seed=seed)
        if command_period is not None and not 0 < command_period < np.inf:
            raise DenseVSError(f"command_period is {command_period!r}; expected a finite number of seconds above 0")
        if renew_patch is not None and not 0 < renew_patch < 1:
            raise DenseVSError(f"renew_patch is {renew_patch!r}; expected a correlation between 0 and 1")
        self.renew_patch = renew_patch
        self.command_period = command_period
        pace = {} if command_period is None else {"frame_time": command_period}
        self.babbling = babbling or Babbling(joints, seed=seed, **pace)
        self._next_command = time
        self.pipeline = FramePipeline(estimator, flow, scale=scale, body=body)
        self.tracker: PointTracker | None = None
        self.target: np.ndarray | None = None
        self.on_frame = on_frame
        self._buffer = JointBuffer(joints)
        self._take(image, time)

    @property
    def frame(self) -> Frame:
        """The last frame."""
        assert self.pipeline.frame is not None  # the constructor took one
        return self.pipeline.frame

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
        self.robot.command(delta)
        frame = self._take(*self.camera.read())
        if self.tracker is not None:
            self.tracker.update(frame.flow, frame.gray)
            self._renew_patch(self.tracker)
        if self.on_frame is not None:
            self.on_frame(self)
        return frame

    def babble(self, seconds: float) -> None:
        """Move at random for that long on the camera's clock, learning J."""
        if not np.isfinite(seconds) or seconds <= 0:
            raise DenseVSError(f"babbling of {seconds!r} s; expected a finite number above 0")
        end = self.frame.time + seconds
        while self.frame.time < end:
            self.step(self._when_due(lambda: self._limited(self.babbling.step(self._pacing_flow()))))

    def define_point(self, point: Any, **options: Any) -> None:
        """Choose the point of the body to control, at its place in the last image [px].

        Pixels whose J differs from the point's by more than half are left out of its alignment:
        they move otherwise, so they are another body or the background.

        Args:
            point: ``(2,)`` [px].
            options: of :class:`PointTracker`.
        """
        self.tracker = PointTracker(point, self.frame.gray, weights=self._same_surface(point), **options)

    def reach(self, target: Any, *, tolerance: float = 1.0, settle_frames: int = 5, max_frames: int = 150) -> Reach:
        """Servo the defined point to a target; stops where the tracker has lost the point, as it would go on blind.

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
        while frames < max_frames and settled < settle_frames and not self._lost:
            self.step(self._when_due(self._servo_step))
            frames += 1
            distance = float(np.hypot(*(self.point - self.target)))
            settled = settled + 1 if distance <= tolerance else 0
        goal = float(self.target[0]), float(self.target[1])
        return Reach(goal, frames, distance, settled >= settle_frames and not self._lost, self._lost)

    def _pacing_flow(self) -> np.ndarray | None:
        """The last flow, without what is known not to be the robot once the robot itself is known."""
        flow, body = self.frame.flow, self.pipeline.body
        if flow is None or body is None:
            return flow
        found = body.recognition(self.estimator.jacobian)
        if np.mean(found == 1) < LEAST_BODY:
            return flow
        return np.where((found == 0)[..., None], np.float32(np.nan), flow)

    def _servo_step(self) -> np.ndarray:
        J = self.estimator.at(self.point)[0]
        return self.servo(J, self.point, self.target, self.frame.positions)

    def _when_due(self, choose: Callable[[], np.ndarray]) -> np.ndarray:
        """The chosen joint step where a command is due by now, else zero."""
        if self.command_period is None:
            return choose()
        late = self.frame.time - self._next_command
        if late < -1e-6:  # s; stamps are sums of rounded numbers
            return np.zeros(self.estimator.options.joints)
        # On a grid, which begins anew after a pause.
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
        own = self.estimator.at(point)[0]
        size = np.linalg.norm(own)
        if size == 0:
            return None
        return np.linalg.norm(self.estimator.to_numpy() - own, axis=(2, 3)) <= SAME_SURFACE * size

    @property
    def _lost(self) -> bool:
        return bool(self.tracker is not None and self.tracker.lost[0])

    def _take(self, image: np.ndarray, time: float) -> Frame:
        self._buffer.add(*self.robot.joints())
        return self.pipeline.process(image, time, self._buffer.at(time))

    def _limited(self, delta: np.ndarray) -> np.ndarray:
        if self.joint_limits is None:
            return delta
        limits = np.asarray(self.joint_limits)
        return np.clip(self.frame.positions + delta, limits[:, 0], limits[:, 1]) - self.frame.positions
