"""What a session does about the robot's body: has it learned after a babbling, and lets loop and points use it."""

from typing import TYPE_CHECKING

from dense_vs.body_model import BodyModel
from dense_vs.live.body_process import BodyProcess, BodyState
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.point_servo.learned_body import LEAST_IMAGES
from dense_vs.point_servo.loop import ServoLoop

if TYPE_CHECKING:
    from dense_vs.live.session import LiveSession


class BodyTask:
    """A session's body; all of it in the loop's thread.

    Args:
        session: whose loop has begun.
    """

    def __init__(self, session: "LiveSession"):
        self._session = session
        loop = session.running_loop()
        self._delay = loop.joint_delay
        self._images = 0  # that there were when it was last to be learned
        self.process: BodyProcess | None = None
        if session.source.commands and session.options.body:
            options = loop.estimator.options
            self.process = BodyProcess((options.height, options.width), loop.group, self._learned)
            if loop.body_model is not None:  # of a checkpoint
                self.process.use(loop.body_model)

    @property
    def state(self) -> BodyState:
        """What is known of the body."""
        return BodyState.UNKNOWN if self.process is None else self.process.state

    @property
    def wanted(self) -> bool:
        """Whether one is to be learned: there is none, or one that no longer explains what moves."""
        return self.process is not None and self.process.alive and self._session.running_loop().learned_body.wanted

    @property
    def images_missing(self) -> int:
        """Images that are to come before it can be learned; 0 where none is to be learned."""
        if self.process is None or not self.wanted:
            return 0
        return max(LEAST_IMAGES - self.process.images, 0)

    def told(self) -> dict[str, int] | None:
        """How many images have come, and how many it takes; None where none is to be learned."""
        if self.process is None or not self.wanted:
            return None
        return {"have": min(self.process.images, LEAST_IMAGES), "need": LEAST_IMAGES}

    def frame(self, number: int, frame: ProcessedFrame) -> None:
        """Take a frame that was learned from."""
        if self.process is None:
            return
        delay = self._session.running_loop().joint_delay
        if delay != self._delay:
            self._delay = delay
            self.process.forget_images()
        self.process.frame(number, frame)

    def learn(self) -> None:
        """Have it learned from the images so far, where one is wanted."""
        if self.process is not None and self.wanted:
            self._images = self.process.images
            loop = self._session.running_loop()
            self.process.learn(loop.frame.positions, loop.learned_body.agrees)
            self._session.board.log("learning the body from what was seen; points go by their own look until then")

    def take_over(self, loop: ServoLoop) -> None:
        """Let a loop that begins anew go on with the body that the one before knew."""
        before = self._session.loop
        if self.process is not None and before is not None and before.body_model is not None:
            loop.use_body(before.body_model)

    def forget(self) -> None:
        """Forget it, as J is forgotten; points go by their own look again."""
        loop = self._session.running_loop()
        if self.process is not None:
            self.process.forget()
        self._session.points.follow_by_patches(loop.frame, loop.pipeline)

    def end(self) -> None:
        """End its process."""
        if self.process is not None:
            self.process.end()

    def _learned(self, model: BodyModel | None, told: str) -> None:
        """From the process's thread: the model, or that there is none."""
        self._session.ask(lambda: self._use(model, told))

    def _use(self, model: BodyModel | None, told: str) -> None:
        session = self._session
        loop, process = session.running_loop(), self.process
        if model is None:
            if process is not None and not process.alive:
                session.board.log("the body's process ended; points go by their own look", "error")
            elif self._images < LEAST_IMAGES:
                came = f"{self._images} images came, it takes {LEAST_IMAGES}"
                session.board.log(f"the body was not found: {came}; points go by their own look", "warning")
            else:
                session.board.log("the body was not found in these images; points go by their own look", "warning")
        elif process is not None and process.knows:
            loop.use_body(model)
            session.points.seek_by_body(loop.frame, loop.pipeline, session.number)
            learned = f"body learned: its tracks fit within {model.error:.2f} px; points go by their links"
            session.board.log(told or learned, "warning" if told else "info")
