"""The closed loop on a robot: babble until J is learned, then bring a point of the body to image targets."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from dense_vs.arrays import number_array, point_array
from dense_vs.body.self_body import SelfBody
from dense_vs.body_model import BodyModel
from dense_vs.checks import check_choice, check_number, check_whole
from dense_vs.device import one_blas_thread
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.health.joint_watch import JointWatch
from dense_vs.health.motion_check import BABBLING_SHARE, LEAST_SHARE
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame
from dense_vs.point_servo.aim import Aim
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.command_pace import CommandPace
from dense_vs.point_servo.following import PointFlow, follow, found_again, new_tracker, pacing_flow, point_jacobian
from dense_vs.point_servo.joint_stream import JointStream
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.learned_body import LearnedBody, check_body
from dense_vs.point_servo.loop_parts import check_parts, loop_babbling, loop_estimator, read_camera, read_depth
from dense_vs.point_servo.point_memory import PointMemory
from dense_vs.point_servo.reach import Arrival, Reach
from dense_vs.point_servo.reaching import Reaching
from dense_vs.point_servo.same_surface import patch_weights
from dense_vs.point_servo.tracker import Method, PointTracker, TrackerOptions
from dense_vs.recording.joint_delay import LEAST_FRAMES
from dense_vs.robot.babbling import Babbling
from dense_vs.robot.command_gate import MAX_AGE, CommandGate
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, Robot
from dense_vs.robot.stamped import read_image

MOST_GAP = 2.0  # s between two images, after which the loop begins anew with what it has learned
MOST_HELD = 30  # images that wait for their joint readings; a robot whose readings stop is not waited for


class ServoLoop:
    """Runs camera, flow, estimator, tracker and servo, a frame at a time.

    Args:
        camera, robot: of one robot, on one clock.
        joints: names of the N joints to use, in this order; the others get no command. All unless given.
        estimator: for the camera's images once scaled and the N joints; made to fit unless given.
        servo: the control law; made with the joints' limits unless given.
        flow: of the estimator's size; the default method unless given.
        babbling: the motion before J is known; by default wider for some seconds where a body is learned.
        scale: factor on the image size.
        threads, device, depth: of an estimator made here; with depth the camera is a :class:`DepthCamera`.
        seed: of babbling and of the servo's dither.
        command_period: between commands [s]; in the frames between them J is learned. Every frame unless given.
        body: labels the robot's own pixels, see :meth:`FramePipeline.labels`; once it knows some, what else moves no
            longer slows the babbling down.
        body_model: from an earlier run; with True one is learned after babbling, with False none is used. It is J's
            prior, see :class:`BodyPrior`, and what points are followed by. Where it does not explain what moves, a
            babbling ends with finding out what has changed, or with learning one anew, see :class:`LearnedBody`.
        renew_patch: correlation below which the patch of a point followed as "aligned" is taken anew, so that surfaces
            that turn are not lost; each time may add hundredths of a pixel of drift. Kept unless given.
        joint_delay: time that joint readings are behind the images [s], below 0 where the images are late. Unless given
            it is found in the first 2 s of babbling, and more exactly in the first 10; where there is one, learning
            begins anew, and an image waits until the readings of its time are there.
        max_step: largest step of a joint in one command, a number or one for each joint [rad, m]; what babbling and
            servo are set to unless given. See :class:`dense_vs.robot.CommandGate`, which every command goes through.
        max_speed: of a joint [rad/s, m/s]; faster readings are not believed. Twice the largest step by default.
        sway: whether the camera may sway, see :class:`FramePipeline`.
        on_frame: called with the loop after every frame; a viewer, a recorder, an evaluation.

    A fault (:attr:`faults`) that ``stops`` lets nothing be commanded; one that ``holds`` lets nothing be learned.

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
        body_model: BodyModel | bool = True,
        renew_patch: float | None = None,
        joint_delay: float | None = None,
        max_step: Any = None,
        max_speed: float | None = None,
        sway: bool = False,
        depth: bool = False,
        on_frame: Callable[["ServoLoop"], None] | None = None,
    ):
        self.camera, self.robot = camera, robot
        self.group = JointGroup.of_robot(robot, joints)
        count = len(self.group.names)
        check_parts(count, servo=servo, flow=flow, babbling=babbling, body=body, on_frame=on_frame)
        image, time = read_image(camera)
        where = {"device": device, "threads": threads}
        self.estimator = estimator = loop_estimator(estimator, camera, image, self.group, scale, depth=depth, **where)
        self.servo = servo or VisualServo(count, joint_limits=self.group.limits, seed=seed)
        self.renew_patch = None if renew_patch is None else check_number("renew_patch", renew_patch, above=0, below=1)
        self._pace = CommandPace(command_period, time)
        self.pipeline = FramePipeline(estimator, flow, scale=scale, body=body, watched=True, sway=sway)
        self.learned_body = LearnedBody(self.pipeline, self.group, body_model)
        self._learns_body = bool(body_model)
        self.babbling = babbling or loop_babbling(count, seed, command_period, self.learned_body.wanted)
        steps = self.babbling.largest_step, self.servo.options.max_step + 4 * self.servo.options.dither
        self.gate = CommandGate(robot, self.group, max_step=max(steps) if max_step is None else max_step)
        watch = JointWatch(self.group.names, self.gate.max_step, max_speed)
        self._point_flow = PointFlow(estimator.options.height, estimator.options.width)
        self.tracker: PointTracker | BodyTracker | None = None
        self.memory: PointMemory | None = None
        self.aim = Aim(estimator)
        self.on_frame = on_frame
        delay = None if joint_delay is None else check_number("joint_delay", joint_delay)
        self.joints = JointStream(robot, self.group, watch, delay)
        self._held: deque[tuple[np.ndarray, float, Any, tuple[Fault, ...]]] = deque()  # images that wait for readings
        self._newest = time
        faults, depth = self.joints.read(time), read_depth(camera, estimator)
        self._frame = self._followed = self.pipeline.process(image, time, self.joints.at(time), faults, depth)

    @property
    def frame(self) -> ProcessedFrame:
        """The last frame; with late joint readings, the last one that they have reached."""
        return self._frame

    @property
    def body_model(self) -> BodyModel | None:
        """Of the robot; None where none is known."""
        return self.learned_body.model

    @property
    def faults(self) -> tuple[Fault, ...]:
        """What is wrong with the last frame; empty where nothing is."""
        return self._frame.faults

    @property
    def joint_delay(self) -> float:
        """Time that joint readings are behind the images, as far as is known [s]."""
        return self.joints.delay

    @property
    def point(self) -> np.ndarray:
        """Where the tracked point is, ``(2,)`` [px].

        Raises:
            DenseVSError: none is defined yet.
        """
        if self.tracker is None:
            raise DenseVSError("no point is defined; expected define_point() first")
        return self.tracker.points[0]

    @property
    def point_depth(self) -> float:
        """Depth of the tracked point [m]; NaN where it is not known, or the loop has no depth."""
        return self.aim.depth

    @property
    def target(self) -> np.ndarray | None:
        """Where the point is to be, ``(2,)`` [px], ``(3,)`` with depth [m]; None before the first reach."""
        return self.aim.target

    @one_blas_thread()
    def step(self, delta: np.ndarray) -> ProcessedFrame:
        """Command a joint step ``(N,)`` [rad], then take the next image through estimator and tracker.

        A step of zero is commanded instead while :attr:`faults` stop the robot, see :class:`CommandGate`.

        Raises:
            DenseVSError: not N finite numbers; nothing has been commanded then.
        """
        sent = self.gate.send(
            np.where(self.joints.watch.stuck, 0.0, number_array(delta, "delta", (self.estimator.options.joints,))),
            self.joints.reading,
            image_time=self.frame.time if not self._held else None,
            now=self._newest,
            reading_time=self.joints.newest_time,
            stop="; ".join(str(fault) for fault in self.faults if fault.stops) or self._waited_long(),
        )
        self.joints.watch.commanded(sent)
        frame = self._take(*read_camera(self.camera, self.estimator))
        if all(fault.kind not in (FaultKind.DARK, FaultKind.FROZEN) for fault in frame.faults):
            if self.tracker is not None and frame is not self._followed:
                self._follow_point(self.tracker, frame)
            if (doubt := self.learned_body.see(self._frame)) is not None:
                self._say(doubt)
        if self.on_frame is not None:
            self.on_frame(self)
        return self._frame

    def resume(self) -> None:
        """Begin anew with the next image and reading as they are, keeping J and the tracked point.

        For a robot that was moved by someone else, or whose encoders or clock were set: their step is no motion.

        Raises:
            DenseVSError: stamps of joints and camera that are not of one clock.
        """
        self._restart()
        self._take(*read_camera(self.camera, self.estimator))

    def _restart(self) -> None:
        for part in (self.joints, self.gate, self.pipeline):
            part.restart()
        self._held.clear()
        self._newest = -np.inf

    def babble(self, seconds: float) -> None:
        """Move at random for that long on the camera's clock, learning J, then a body model where there is none."""
        end = self.frame.time + check_number("seconds", seconds, above=0)
        self._judge_motion(BABBLING_SHARE)
        while self.frame.time < end:
            self.babble_once()
        while self._held:  # let what is known catch up with where the robot is
            before = len(self._held)
            self.step(np.zeros(self.estimator.options.joints))
            if len(self._held) >= before:
                break
        self._judge_motion(LEAST_SHARE)
        if self.learned_body.wanted:
            self.learn_body()

    def use_body(self, model: BodyModel) -> None:
        """Go on with a body model that was learned elsewhere, as in a process apart.

        Raises:
            DenseVSError: no model, or one of another number of joints or image size.
        """
        self.learned_body.use(check_body(model), self.frame.positions)

    def forget(self) -> None:
        """Forget J and the body, as after the camera was moved, and begin with the next image. Points stay."""
        self.pipeline.restart(forget=True)
        self.pipeline.prior = None
        self.learned_body = LearnedBody(self.pipeline, self.group, self._learns_body)

    def learn_body(self) -> bool:
        """Learn the body model from the images so far, as :meth:`babble` does, in some seconds; whether it is known."""
        return self.learned_body.learn(self.frame.positions)

    def babble_once(self) -> ProcessedFrame:
        """One frame of babbling, for a program that decides after every frame whether to go on."""
        frame = self.step(self.when_due(self._babbling_step))
        if self.joints.finding and (change := self.joints.find_delay(self.frame)):
            self.pipeline.restart(forget=abs(change) >= LEAST_FRAMES * self.joints.watch.frame_time)
            self.learned_body.retime(self.joints.kept_at)
        return frame

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

        Pixels whose J differs from the point's by more than half are left out of its alignment: they move otherwise,
        so they are another body or the background. So are those that are not labeled as the robot's, where it is known.

        Args:
            point: ``(2,)`` [px].
            method: ``"link"``, by the motion of its whole link, see :class:`BodyTracker`, where there is a body
                model, else as ``"aligned"``; or one of :class:`PointTracker`.
            window, lost_after, min_correlation, max_jump: see :class:`PointTracker`.
        """
        options = {"window": window, "min_correlation": min_correlation, "max_jump": max_jump, "lost_after": lost_after}
        check_choice("method", method, ("link", *get_args(Method)))
        kind: Method = "aligned" if method == "link" else method
        TrackerOptions(method=kind, **options)  # also where it is followed by its link
        place, frame = point_array(point, "point"), self.frame
        weights = patch_weights(self.pipeline, place, window)
        memory = PointMemory(place, frame.positions, frame.gray, weights, {"method": kind, **options}, method == "link")
        self.tracker = new_tracker(memory, frame, self.learned_body if memory.by_link else None)
        self.memory, self._followed = memory, frame
        self.aim.follow(self.point)

    def find_again(self) -> bool:
        """Look for the point in the last image, which is from the posture that it was defined in; whether it is seen.

        From there on it is followed as before or, where a body model can be learned by now, by its link.
        """
        if (memory := self.memory) is None or (found := found_again(memory, self.tracker, self.frame)) is None:
            return False
        self.tracker, by_patch = found, isinstance(found, PointTracker) and memory.by_link
        if by_patch and self.learned_body.wanted and self.learned_body.learn(self.frame.positions, reaching=True):
            self.define_point(found.points[0], **{**memory.options, "method": "link"})
        self.aim.follow(self.point)
        return True

    @one_blas_thread()
    def reach(self, target: Any, *, tolerance: float = 1.0, settle_frames: int = 5, max_frames: int = 600) -> Reach:
        """Servo the defined point to a target by DIJE (17), in the image or in image and depth.

        A point that is followed by its link goes far ways by planned moves, and counts as reached only where what is
        seen of the link agrees on its place. One that is followed by its patch alone, as a body was sought and none
        found, or none of its links has it, is called lost. One that is lost is looked for where it was defined, once.

        Args:
            target: ``(2,)`` [px]; in a loop with depth also ``(3,)`` [px, px, m].
            tolerance: distance that counts as there [px]; a meter of depth counts as one across the image there. Of a
                point followed by its link the place has to be known as well, to about twice that or 2 px: a larger
                one is reported as reached more often.
            settle_frames: frames it has to stay there; it may then come closer for 15 more.
            max_frames: frames after which it gives up.

        Raises:
            DenseVSError: no point defined or of unknown depth, a target that is not such numbers, a tolerance that is
                not above 0, or frames that are no whole numbers of at least 1.
        """
        tolerance = check_number("tolerance", tolerance, above=0)
        arrival = Arrival(tolerance, check_whole("settle_frames", settle_frames, least=1))
        reaching = Reaching(self, arrival, check_whole("max_frames", max_frames, least=1))
        self.aim.at(target, self.point, self.body_model)
        return reaching.run()

    def _babbling_step(self) -> np.ndarray:
        frame = self.frame
        return self.group.clip_step(self.babbling.step(pacing_flow(self.pipeline, frame), frame.time), frame.positions)

    def servo_step(self) -> np.ndarray:
        """Joint step ``(N,)`` [rad] of DIJE (17) toward the target; DenseVSError without a point or a target."""
        point, q = self.point, self.joints.newest
        assert self.tracker is not None  # or there were no point
        J = point_jacobian(self.tracker, self.pipeline, self.frame.positions)
        moved = q - self.frame.positions  # as far as an image comes late
        return self.aim.step(self.servo, point, J, moved, q, self.joints.watch.stuck)

    def when_due(self, choose: Callable[[], np.ndarray]) -> np.ndarray:
        """The chosen joint step where a command is due by now and nothing stops the robot, else zero."""
        if any(fault.stops for fault in self.faults) or not self._pace.due(self.frame.time):
            return np.zeros(self.estimator.options.joints)
        return choose()

    def _judge_motion(self, least_share: float) -> None:
        if self.pipeline.check is not None:
            self.pipeline.check.least_share = least_share

    def _take(self, image: np.ndarray, time: float, depth: Any = None) -> ProcessedFrame:
        """The last frame that this image lets be processed: itself, or an earlier one that waited for its readings."""
        if time - self._newest > MOST_GAP:
            self._restart()
        faults = self.joints.read(time)
        self._newest = max(self._newest, time)
        if self.joints.delay <= 0 and not self._held:
            return self._process(image, time, depth, faults)
        kept = None if depth is None else np.array(depth)
        self._held.append((np.array(image), time, kept, faults))  # a camera may reuse its buffer
        while self._held and (self.joints.has(self._held[0][1]) or len(self._held) > MOST_HELD):
            self._process(*self._held.popleft())
        return self._frame

    def _process(self, image: np.ndarray, time: float, depth: Any, faults: tuple[Fault, ...]) -> ProcessedFrame:
        self._frame = frame = self.pipeline.process(image, time, self.joints.at(time), faults, depth)
        check = self.pipeline.check
        changed = None if check is None else self.joints.judge_motion(frame, check)
        if changed is not None:
            fault, since = changed
            self.learned_body.retime(self.joints.kept_at, since)
            self.pipeline.restart()
            self._say(fault, positions=self.joints.at(time))
        return self._frame

    def _say(self, fault: Fault, **known: Any) -> None:
        """Add what is wrong to the last frame, and what is known better by it."""
        followed = self._followed is self._frame
        self._frame = replace(self._frame, faults=(*self._frame.faults, fault), **known)
        if followed:
            self._followed = self._frame

    def _waited_long(self) -> str:
        """Why nothing may be commanded where images wait for their readings."""
        late = self._newest - self.frame.time
        return f"the image is {late:.3f} s old" if late > MAX_AGE + max(self.joints.delay, 0.0) else ""

    def _follow_point(self, tracker: PointTracker | BodyTracker, frame: ProcessedFrame) -> None:
        """Take the tracked point along from the last frame that it was followed in, and say where it is not seen."""
        last, self._followed = self._followed, frame
        unseen = follow(tracker, self.pipeline, self._point_flow, last, frame, self.renew_patch)
        self.aim.update(self.point, frame.positions - last.positions, frame.depth)
        if unseen:
            self._say(Fault(FaultKind.POINT, unseen, stops=False, holds=False))
