"""A session's checkpoint: taken up when the session begins, brought up to date while it runs."""

from typing import TYPE_CHECKING

from dense_vs.errors import DenseVSError
from dense_vs.live.mode import Mode
from dense_vs.point_servo.checkpoint import Checkpoint

if TYPE_CHECKING:
    from dense_vs.live.session import LiveSession


class Keeping:
    """Keeps what a session learns in the file that its options name; without one it does nothing.

    Args:
        session: whose loop has begun; it goes on with what the file holds.
    """

    def __init__(self, session: "LiveSession"):
        self._session = session
        self._checkpoint: Checkpoint | None = None
        self._seconds = 0.0
        self._said = ""
        path, loop = session.options.checkpoint, session.running_loop()
        if path is None:
            return
        options = loop.estimator.options
        try:
            self._checkpoint = Checkpoint(path, loop.group.names)
            size = options.height, options.width
            kept = self._checkpoint.resume(size, device=session.options.device, threads=session.options.threads)
            if kept is not None:
                kept.bring_to(loop.frame.positions)
                session.use(kept.estimator)
                with_body = kept.body is not None and session.options.body
                if kept.body is not None and with_body:
                    session.running_loop().use_body(kept.body)
                self._seconds = kept.seconds
                learned = f"learned in {kept.seconds:.0f} s of motion" + ", with its body" * with_body
                session.board.log(f"going on from {path}, {learned}")
        except DenseVSError as error:  # another robot's file must stay as it is
            self._checkpoint = None
            session.board.log(f"no checkpoint is kept: {error}", "error")

    def frame(self) -> None:
        """Keep the file up to date; in the loop's thread, after every frame."""
        if self._checkpoint is None:
            return
        session, loop = self._session, self._session.running_loop()
        if session.mode is Mode.LEARNING:
            self._seconds += session.robot.frame_seconds
        if not loop.estimator.updates:
            return
        try:
            self._checkpoint.keep(loop, self._seconds)
        except DenseVSError as error:  # a full disk is no reason to stop the robot
            self._say(error)

    def end(self) -> None:
        """Wait for a write that is under way."""
        if self._checkpoint is None:
            return
        try:
            self._checkpoint.finish()
        except DenseVSError as error:
            self._say(error)

    def _say(self, error: DenseVSError) -> None:
        if str(error) != self._said:
            self._said = str(error)
            self._session.board.log(self._said, "warning")
