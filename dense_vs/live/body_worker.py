"""What the body's process does: learns the body model from the frames it is sent, and follows points by it.

It is the loop's own way, :class:`LearnedBody` and :func:`follow`, beside the loop: a fit takes seconds, a point's look
back at the images so far half a second, and now and then a frame of it a tenth. Started by :class:`BodyProcess`:

    python -m dense_vs.live.body_worker FILE_DESCRIPTOR
"""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import warp as wp

from dense_vs.body_model import BodyModel
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.live.seen_point import SeenPoint
from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.following import PointFlow, follow
from dense_vs.point_servo.learned_body import LearnedBody
from dense_vs.robot.joint_group import JointGroup

PATIENCE = 5  # less important to the system than the loop, by so much of nice
WINDOW, LOST_AFTER = 25, 15  # as of ServoLoop.define_point


class BodyWorker:
    """The body and the points that are followed by it.

    Args:
        size: height and width of the images [px].
        group: the robot's joints.
        say: takes an answer, a tuple that begins with its name.
    """

    def __init__(self, size: tuple[int, int], group: JointGroup, say: Callable[[tuple[Any, ...]], None]):
        height, width = size
        joints = len(group.names)
        estimator = DenseJacobian(height=height, width=width, joints=joints, device="cpu", threads=1)
        self._pipeline = FramePipeline(estimator)
        self._point_flow = PointFlow(height, width)
        self._group, self._say = group, say
        self._points: dict[int, BodyTracker] = {}
        self.forget()

    def forget(self) -> None:
        """Know no body, no images and no points."""
        self._pipeline.prior = None
        self._body = LearnedBody(self._pipeline, self._group, True)
        self._points.clear()

    def forget_images(self) -> None:
        """The clock of joint readings was found to be another."""
        self._body.forget_images()

    def frame(self, number: int, gray: np.ndarray, positions: np.ndarray, measured: bool, newest: bool) -> None:
        """Take a frame.

        Args:
            number: of the frame.
            gray: uint8 ``(H, W)``.
            positions: joint positions ``(N,)`` [rad].
            measured: whether J was corrected by it: such frames are learned from.
            newest: whether no other waits: points are sought in it.
        """
        shown = shown_frame(gray, positions, measured)
        if self._points and newest:
            for tracker in self._points.values():
                follow(tracker, self._pipeline, self._point_flow, shown, shown, None)
            self._tell(number)
        self._body.see(shown)

    def learn(self, positions: np.ndarray, path: str, agrees: bool) -> None:
        """Learn from the images so far.

        The answer is whether a model is in the file, what has changed in it, and whether one was sought in vain.

        Args:
            positions: present ones ``(N,)`` [rad].
            path: of the file.
            agrees: whether the model that there is explains what moves.
        """
        found = self._body.learn(positions, agrees)
        if found and self._body.model is not None:
            self._body.model.save(path)
        change = self._body.change
        told = "" if change is None or not change.found else change.describe(self._group.names)
        self._say(("learned", found, path, told, self._body.sought_in_vain))

    def use(self, path: str) -> None:
        """Take a model from a file."""
        self._body.use(BodyModel.load(path), None)
        with suppress(OSError):
            Path(path).unlink()

    def follow(
        self, point: int, place: np.ndarray, number: int, gray: np.ndarray, positions: np.ndarray, J: np.ndarray
    ) -> None:
        """Follow the point that is at ``place`` ``(2,)`` [px] in a frame, with the loop's J ``(H, W, 2, N)`` there."""
        estimator, shown = self._pipeline.estimator, shown_frame(gray, positions, False)
        estimator.blend(J, np.ones(J.shape[:2], np.float32))
        tracker = self._body.tracker(place, shown, window=WINDOW, lost_after=LOST_AFTER)
        if tracker is None:  # it is on no link that is known
            self._say(("seen", number, {point: None}))
            return
        self._points[point] = tracker
        self._tell(number, point)

    def drop(self, point: int) -> None:
        """Follow a point no longer."""
        self._points.pop(point, None)

    def _tell(self, number: int, only: int | None = None) -> None:
        seen = {
            point: SeenPoint(tracker.points[0], tracker.certain(), bool(tracker.lost[0]), tracker.usual_uncertainty)
            for point, tracker in self._points.items()
            if only is None or point == only
        }
        self._say(("seen", number, seen))


def shown_frame(gray: np.ndarray, positions: np.ndarray, measured: bool) -> ProcessedFrame:
    """A frame as far as a body is learned and followed from it; what was measured stays with the loop."""
    nothing = np.zeros(0, np.float32)
    return ProcessedFrame(0.0, gray, gray, positions, None, (nothing, nothing) if measured else None)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep what Warp says at its start to itself: the loop's process has said it already, or has kept it so, too."""
    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    before = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)  # its remark that there is no GPU comes from native code
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


def main(descriptor: int) -> None:
    """Do what is asked for through a connection until it is closed."""
    os.nice(PATIENCE)
    cv2.setNumThreads(1)
    with quiet():
        wp.init()
    with Connection(descriptor) as connection, suppress(EOFError, ConnectionError):
        size, group = connection.recv()
        worker = BodyWorker(size, group, connection.send)
        while True:
            name, *values = connection.recv()
            getattr(worker, name)(*values)


if __name__ == "__main__":
    main(int(sys.argv[1]))
