"""The object that a user drew a box around: learned, sought, brought to the image's middle, or followed by a point."""

from typing import TYPE_CHECKING

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.live.live_object import LiveObject, ObjectServo
from dense_vs.live.mode import Mode
from dense_vs.pipeline.frame_pipeline import ProcessedFrame

if TYPE_CHECKING:
    from dense_vs.live.session import LiveSession


class ObjectTask:
    """A session's object; all of it in the loop's thread.

    Args:
        session: whose images it is sought in.

    Attributes:
        known: the object; None without one.
    """

    def __init__(self, session: "LiveSession"):
        self._session = session
        self.known: LiveObject | None = None
        self._servo: ObjectServo | None = None

    def learn(self, corner: tuple[float, float], other: tuple[float, float]) -> None:
        """Learn the object in a box of the present image [px]."""
        self.drop()
        session = self._session
        image = session.running_loop().frame.image
        self.known = LiveObject(image, (*corner, *other), session.board.log, session.options.seed)

    def drop(self) -> None:
        """Forget the object."""
        if self._servo is not None:
            self._servo.stop()
        if self.known is not None:
            self.known.end()
        self.known = None

    def center(self) -> None:
        """Bring the object to the image's middle."""
        known, loop = self._seen(), self._session.running_loop()
        frame, group = loop.frame, loop.group
        J = np.asarray(loop.estimator.at(known.centroid)[0], dtype=np.float64)
        servo = ObjectServo(group.names, group.limits, frame.image, frame.positions, J)
        self._session.begin_mode(Mode.CENTERING)
        self._servo = servo
        known.center(servo)

    def chase(self, number: int) -> None:
        """Let a point's target be where the object is."""
        known = self._seen()
        self._session.points.aim(number, known.centroid)
        known.chaser = number
        self._session.begin_mode(Mode.REACHING)

    def step(self, frame: ProcessedFrame, joints: int) -> np.ndarray:
        """The joint step ``(N,)`` [rad] towards the image's middle; zero while nothing is centered."""
        if self._servo is None:
            return np.zeros(joints)
        return self._servo.advance(frame.image, frame.time, frame.positions)

    def mind(self, frame: ProcessedFrame) -> None:
        """Look for the object in a frame; what follows from where it is."""
        session, servo, known = self._session, self._servo, self.known
        if servo is not None and (session.mode is not Mode.CENTERING or servo.over.is_set()):
            servo.stop()
            self._servo = None
            if session.mode is Mode.CENTERING:
                session.be_still("the object was centered or could not be")
        if known is None:
            return
        known.look(frame.image)
        if known.chaser is not None and known.centroid is not None:
            if known.chaser not in session.points:
                known.chaser = None
            elif session.mode is Mode.REACHING:
                session.points.aim(known.chaser, known.centroid)

    def _seen(self) -> LiveObject:
        """The object.

        Raises:
            DenseVSError: there is none, or it is not seen.
        """
        if self.known is None or self.known.centroid is None:
            raise DenseVSError("no object is seen; expected a box to be drawn around one first")
        return self.known
