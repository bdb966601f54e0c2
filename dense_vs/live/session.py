"""The session: a robot's loop in a thread of its own, which the page steers by requests and sees by snapshots.

The thread reads an image, lets the loop learn and track, decides on a joint step and sends it through the gate; it
never waits for anybody. Requests are carried out between two frames. :meth:`LiveSession.stop` closes the gate at once,
from any thread. A second thread watches the first: where no frame comes, it closes the gate too.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from dense_vs.body.self_body import SelfBody
from dense_vs.drivers.watchdog import Watchdog
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.live.body_process import BodyState
from dense_vs.live.body_task import BodyTask
from dense_vs.live.gate import GatedRobot, PageGate
from dense_vs.live.keeping import Keeping
from dense_vs.live.learning import WINDOW, Learning, sureness
from dense_vs.live.mode import Mode
from dense_vs.live.object_task import ObjectTask
from dense_vs.live.options import LiveOptions, chosen_scale
from dense_vs.live.pacing import PacedCamera
from dense_vs.live.points import LivePoints, PointState
from dense_vs.live.recording_thread import RecordingThread
from dense_vs.live.report import Told, layers, state_of
from dense_vs.live.snapshot import Board, Snapshot
from dense_vs.live.source import CameraTap, LiveSource
from dense_vs.pipeline.explained_motion import ExplainedMotion
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.loop import ServoLoop
from dense_vs.point_servo.tracker import PointTracker
from dense_vs.robot.babbling import Babbling

KEPT_FRAMES = 24  # that a click on an older image is carried through
SLOW_EVERY = 6  # frames between the slower figures
JUDGE_EVERY = 3  # frames between looks at the explained motion while nothing is being learned
GUARD_PERIOD = 0.05  # s
SLOW_FRAMES, MOST_STALL = 6, 2.0  # frames as usual, and s, that may pass without an image
RECORDED_SPEED = 20.0  # rad/s, m/s; a recorded robot keeps to other bounds than the loop's own commands
FAULT_PAUSE = 0.1  # s between two tries after an error


class LiveSession:
    """Runs a camera and a robot for a page.

    Args:
        source: the camera and the robot.
        options: how it runs.

    Attributes:
        board: what the page sees.
        gate: what commands pass through.
        points: what the user clicked; the loop's thread alone changes it.
        loop: the servo loop; None until the first image is there.
        robot: the robot behind the gate.
        mode: what the robot is doing.
        recorder: writes the recording that goes on now; None without one.
        objects, body: the object that is sought, and what is known of the robot's body; None before the first image.
        number: of the last frame.
    """

    def __init__(self, source: LiveSource, options: LiveOptions | None = None):
        self.source, self.options = source, options or LiveOptions()
        self.board, self.gate = Board(), PageGate(self.options.max_speed)
        self.gate.dead_man = self.options.dead_man
        self.camera = CameraTap(source.camera if source.paced else PacedCamera(source.camera))
        self.robot = GatedRobot(source.robot, self.gate)
        self.loop: ServoLoop | None = None
        self.mode = Mode.STARTING
        self.recorder: RecordingThread | None = None
        self.last_recording: RecordingThread | None = None
        self.objects = ObjectTask(self)
        self.body: BodyTask | None = None
        self.told = Told()
        self._keeping: Keeping | None = None
        self._requests: SimpleQueue[tuple[Callable[[], Any], int]] = SimpleQueue()  # each with the stops before it
        self._stops_before: int | None = None  # the request that is being carried out; None between requests
        self._ended = threading.Event()
        self._beat: float | None = None  # when the last frame came, on the computer's clock
        self._pace = 1 / 30  # s a frame on the computer's clock, smoothed
        self._frames: deque[tuple[int, ProcessedFrame]] = deque(maxlen=KEPT_FRAMES)
        self.number = 0
        self._broken = False
        self._followed: ProcessedFrame | None = None  # the last frame that the points were carried into
        self._faulty = 0  # frames one after the other in which the loop itself commanded nothing
        self._last_fault = ("", 0.0)
        self._watchdog: Watchdog | None = None
        self._threads = [
            threading.Thread(target=self._run, name="live loop", daemon=True),
            threading.Thread(target=self._guard, name="live guard", daemon=True),
        ]

    def start(self) -> None:
        """Begin reading images; nothing moves."""
        if self.source.watchdog is not None:
            self._watchdog = Watchdog(self.source.watchdog)
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Stop commands and threads; the robot holds."""
        self.stop("the session ends")
        self._ended.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=5)
        if self._keeping is not None:
            self._keeping.end()
        if self.body is not None:
            self.body.end()
        if self.recorder is not None:
            self.recorder.finish()
        if self._watchdog is not None:
            self._watchdog.end()

    def stop(self, reason: str) -> None:
        """Stop commands now; what the frame in work has decided is not sent. From any thread."""
        if self.gate.close(reason):
            self.board.log(f"stopped: {reason}", "warning")
            try:
                self.robot.hold()
            except Exception as error:  # the gate is closed; a driver that cannot hold must not undo that
                self.board.log(f"the robot was told to hold and did not: {_said_of(error)}", "error")

    def ask(self, request: Callable[[], Any]) -> None:
        """Have the loop's thread carry something out between two frames; its errors go to the log.

        A stop that comes before it is carried out stays: :meth:`begin_mode` is refused then.
        """
        self._requests.put((request, self.gate.stops))

    def running_loop(self) -> ServoLoop:
        """The servo loop.

        Raises:
            DenseVSError: the first image is not there yet.
        """
        if self.loop is None:
            raise DenseVSError("there is no image yet; expected the camera to have given one")
        return self.loop

    def begin_mode(self, mode: Mode) -> None:
        """Let the robot move for a purpose; in the loop's thread.

        Raises:
            DenseVSError: a recording, which follows no commands, or a stop came after this was asked for.
        """
        if not self.source.commands:
            raise DenseVSError(f"{self.source.name} follows no commands; expected a robot")
        time = self.running_loop().frame.time
        self.gate.allow(self._stops_before)
        if mode is Mode.LEARNING:
            self._learning = Learning(self._explained_anew(), time)
            self.board.log("learning: the robot moves at random")
        self.mode = mode

    def be_still(self, reason: str) -> None:
        """Stop by intent, as where learning is done; in the loop's thread."""
        self.mode = Mode.STILL
        self.gate.close(reason, done=True)

    @property
    def body_state(self) -> BodyState:
        """What is known of the robot's body."""
        return BodyState.UNKNOWN if self.body is None else self.body.state

    def forget(self) -> None:
        """Forget J and the body; in the loop's thread."""
        self.be_still("J was forgotten")
        self.running_loop().forget()
        if self.body is not None:
            self.body.forget()
        self.board.log("J and the body were forgotten")

    def frames_since(self, number: int) -> list[ProcessedFrame]:
        """The frame of that number and all after it, as far as kept; the present one at least."""
        kept = [frame for n, frame in self._frames if n >= number]
        return kept or [self.running_loop().frame]

    def use(self, estimator: DenseJacobian | None) -> None:
        """Run the loop with another estimator, or a new one; in the loop's thread. Points stay."""
        delay = None if self.loop is None else self.loop.joint_delay
        width, options = self.camera.again().shape[1], self.options
        self.scale = chosen_scale(options, width)
        babbling = None
        if options.amplitude is not None:
            joints = options.joints or self.robot.joint_names
            babbling = Babbling(len(joints), seed=options.seed, amplitude=options.amplitude)
        loop = ServoLoop(
            self.camera,
            self.robot,
            joints=options.joints,
            estimator=estimator,
            babbling=babbling,
            scale=self.scale,
            device=options.device,
            threads=options.threads,
            seed=options.seed,
            body=SelfBody(device=options.device, threads=options.threads) if options.labels else None,
            joint_delay=delay if estimator is not None and delay else None,
            body_model=options.body,
            max_speed=None if self.source.commands else RECORDED_SPEED,
        )
        if self.body is not None:
            self.body.take_over(loop)
        self.loop = loop
        self._largest = self.loop.gate.max_step.copy()
        self.servo = VisualServo(
            len(self.loop.group.names), joint_limits=self.loop.group.limits, seed=options.seed, dither=0.001
        )
        self._explained_anew()

    def _explained_anew(self) -> ExplainedMotion:
        self.explained = ExplainedMotion(len(self.running_loop().group.names))
        return self.explained

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                if self.mode is Mode.STARTING:
                    self._begin()
                self._answer()
                self._advance()
            except Exception as error:  # whatever it is, it must stop the robot and be said
                self._fault(error)
            if self.mode is Mode.ENDED:
                return

    def _begin(self) -> None:
        self.use(None)
        self._keeping = Keeping(self)
        loop = self.running_loop()
        size = loop.estimator.options.height, loop.estimator.options.width
        self.body = self.body or BodyTask(self)  # a first image that failed may be tried again
        self.points = LivePoints(*size, self.body.process)
        # Kernels compile when first used, better now.
        tracker = PointTracker((size[1] / 2, size[0] / 2), loop.frame.gray)
        tracker.update(np.zeros((*size, 2), np.float32), loop.frame.gray)
        loop.estimator.at(tracker.points)
        loop.estimator.predicted_flow(np.zeros(len(loop.group.names)))
        for _ in range(2):
            loop.step(np.zeros(len(loop.group.names)))
        self.mode = Mode.STILL
        self.gate.reason = ""
        self.board.log(f"{self.source.name}: {len(loop.group.names)} joints, image of {size[1]} x {size[0]} px")

    def _answer(self) -> None:
        while True:
            try:
                request, self._stops_before = self._requests.get_nowait()
            except Empty:
                return
            try:
                request()
            except DenseVSError as error:
                self.board.log(str(error), "error")
            finally:
                self._stops_before = None

    def _advance(self) -> None:
        loop = self.running_loop()
        if self._broken:
            loop.pipeline.restart()  # flow and joint step across the gap would be wrong
            self._broken = False
        before = loop.frame
        learning = self.mode is Mode.LEARNING
        judged = learning or not self.source.commands or (self.mode is not Mode.STILL and not self.number % JUDGE_EVERY)
        loop.pipeline.before_update = self._judge if judged else None
        frame = self._move(loop)
        now = time.monotonic()
        if self._beat is not None:
            self._pace += 0.05 * (now - self._beat - self._pace)
        self._beat = now
        if self._watchdog is not None:
            self._watchdog.beat()
        self.number += 1
        if frame is not before:
            self.robot.frame_seconds = max(frame.time - before.time, 1e-3)
            if not frame.held:
                self._frames.append((self.number, frame))
                if self.body is not None:
                    self.body.frame(self.number, frame)
                self.points.follow(self._followed or before, frame, loop.pipeline, self.number)
                self._followed = frame
        if self.recorder is not None and self.camera.picture is not None:
            self.recorder.add(self.camera.picture, self.camera.time, *self.robot.joints())
        if self.camera.time - self.robot.reading_time > self.options.stall_seconds:
            self.stop("the joint readings stalled")
        if self.mode is not Mode.STILL and not self.gate.open:
            self.mode = Mode.STILL
        self._look_after(frame)
        if self._keeping is not None:
            self._keeping.frame()
        self._publish(frame, before if frame is not before else None)

    def _move(self, loop: ServoLoop) -> ProcessedFrame:
        # The loop has to know how much is sent: it watches whether the joints follow.
        loop.gate.max_step = np.minimum(self._largest, loop.group.take(self.robot.largest_step))
        if self.mode is Mode.LEARNING and self.gate.passing:
            return loop.babble_once()
        step = np.zeros(len(loop.group.names))
        if self.mode is Mode.REACHING and self.gate.passing:
            step = self.points.step(self.servo, loop)
        if self.mode is Mode.CENTERING and self.gate.passing:
            step = self.objects.step(loop.frame, len(step))
        return loop.step(step)

    def _look_after(self, frame: ProcessedFrame) -> None:
        """What follows from a frame: learning is done, a point got lost or arrived."""
        told = self.told
        if self.number % SLOW_EVERY == 0:
            told.sureness = sureness(self.running_loop().estimator)
            told.explained = self.explained.explained(frame.time - WINDOW, frame.time)
            missing = 0 if self.body is None else self.body.images_missing
            if self.mode is Mode.LEARNING and (verdict := self._learning.verdict(frame.time, told.sureness, missing)):
                good, text = verdict
                self.be_still("learned" if good else "not learned")
                self.board.log(f"{'learned' if good else 'not learned'}: {text}", "info" if good else "warning")
                if self.body is not None:
                    self.body.learn()
        self._mind_faults()
        self.objects.mind(frame)
        for line, level in told.changes(self.points):
            self.board.log(line, level)
        aimed = [point for point in self.points if point.target is not None]
        if self.mode is Mode.REACHING and (not aimed or all(point.state is PointState.LOST for point in aimed)):
            self.stop("every point is lost" if aimed else "no point has a target")
            self.mode = Mode.STILL
        self.board.plot(frame.time, self.points.worst_error, told.explained)

    def _mind_faults(self) -> None:
        """Say what the loop finds wrong; where that lasts, motion has to be asked for again."""
        faults = [fault for fault in self.running_loop().faults if fault.stops]
        self._faulty = self._faulty + 1 if faults else 0
        if faults and self._faulty * self.robot.frame_seconds > self.options.stall_seconds:
            self.stop(str(faults[0]))

    def _judge(self, stamp: float, flow: np.ndarray, dq: np.ndarray) -> None:
        self.explained.observe(stamp, flow, self.running_loop().estimator.to_numpy(), dq)

    def _publish(self, frame: ProcessedFrame, before: ProcessedFrame | None) -> None:
        assert self.camera.picture is not None
        shown = layers(self.running_loop(), frame, self.board.wanted)
        state = state_of(self, frame)
        self.board.show(Snapshot(self.number, frame, before, self.camera.picture, shown, state))

    def _fault(self, error: Exception) -> None:
        """Stop, say what happened and try again: a camera or a bus may come back."""
        text = _said_of(error)
        self.stop(text)
        self._broken = True
        said, when = self._last_fault
        if text != said or time.monotonic() - when > 10:
            self._last_fault = text, time.monotonic()
            self.board.log(text, "error")
        if self.mode is not Mode.STARTING:
            self.mode = Mode.STILL if self.source.commands else Mode.ENDED
        self._ended.wait(FAULT_PAUSE)

    def _guard(self) -> None:
        """Close the gate where the loop gives no frame, for whatever reason."""
        said = False
        while not self._ended.wait(GUARD_PERIOD):
            if self._beat is None or self.mode is Mode.ENDED or not self.source.commands:
                continue
            # A loop that is slow by itself, as on a busy computer, has not stalled.
            allowed = max(self.options.stall_seconds, min(SLOW_FRAMES * self._pace, MOST_STALL))
            stalled = time.monotonic() - self._beat > allowed
            if stalled and not said:
                self.stop("the camera stalled")
                self.board.log(f"no image for {allowed:.1f} s", "error")
            elif said and not stalled:
                self.board.log("images come again")
            said = stalled


def _said_of(error: Exception) -> str:
    """An error as the page says it; one that is not ours with its kind, as its text alone may be a number."""
    return str(error) if isinstance(error, DenseVSError) else f"{type(error).__name__}: {error}"
