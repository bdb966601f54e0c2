"""The robot's body in a process apart: what the loop's thread asks of it and hears from it, without ever waiting.

A fit takes several seconds of CPU, in a thread it would slow down every frame. The process gets the loop's frames and
answers with a body model, and with where it has seen the points that it follows; see :mod:`dense_vs.live.body_worker`.
It shares nothing with the page: what goes through its connection is ours.
"""

import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.body_model import BodyModel
from dense_vs.errors import DenseVSError
from dense_vs.live.seen_point import SeenPoint
from dense_vs.pipeline.frame_pipeline import ProcessedFrame
from dense_vs.point_servo.learned_body import teaches
from dense_vs.robot.joint_group import JointGroup

MOST_WAITING = 64  # frames that wait for the process, as while it fits; the oldest go
END_SECONDS = 2.0  # that it may take to end by itself
WORKER = "dense_vs.live.body_worker"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class BodyState(StrEnum):
    """What is known of the body."""

    UNKNOWN = "unknown"
    LEARNING = "learning the body"
    KNOWN = "known"
    NOT_FOUND = "not found"


class BodyProcess:
    """Starts the process, sends it frames and requests, and keeps its answers.

    Args:
        size: height and width of the images [px].
        group: the robot's joints.
        learned: called once a fit is over, from a thread of its own, with the model or None, and what has changed since
            the one before where that is why there is another.

    Attributes:
        state: what is known of the body.
        images: that it has or will get, and can learn from.
        sought_in_vain: whether enough of them showed no body that is believed, and none is known since.
    """

    def __init__(self, size: tuple[int, int], group: JointGroup, learned: Callable[[BodyModel | None, str], None]):
        self._learned = learned
        self.state, self.images, self.sought_in_vain = BodyState.UNKNOWN, 0, False
        self._kept: np.ndarray | None = None  # joints of the last image that it can learn from
        self._news = threading.Condition()
        self._waiting: deque[tuple[Any, ...]] = deque([(size, group)])
        self._answers: deque[tuple[int, dict[int, SeenPoint | None]]] = deque(maxlen=4 * MOST_WAITING)
        self._over = False
        self._folder = tempfile.TemporaryDirectory(prefix="dense-vs-body-")
        ours, theirs = socket.socketpair()
        with theirs:
            # A session of its own: Ctrl+C reaches the loop, which ends it.
            self._process = subprocess.Popen(
                [sys.executable, "-m", WORKER, str(theirs.fileno())],
                pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, start_new_session=True,
                env=os.environ | ONE_THREAD, stdout=subprocess.DEVNULL,
            )  # fmt: skip
        self._connection = Connection(ours.detach())
        self._threads = [
            threading.Thread(target=self._send, name="body requests", daemon=True),
            threading.Thread(target=self._receive, name="body answers", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def knows(self) -> bool:
        """Whether it knows the body and is there."""
        return self.state is BodyState.KNOWN and self.alive

    @property
    def alive(self) -> bool:
        """Whether the process is there."""
        return not self._over and self._process.poll() is None

    def frame(self, number: int, frame: ProcessedFrame) -> None:
        """Send a frame, or leave it out where it says nothing and others wait already."""
        with self._news:
            kept = teaches(frame, self._kept)
            frames = [item for item in self._waiting if item[0] == "frame"]
            if frames and not kept:
                return
            if len(frames) >= MOST_WAITING:
                self._leave_out(frames[:1])
            if kept:
                self._kept = frame.positions
                self.images += 1
            self._ask("frame", number, frame.gray, frame.positions, kept)

    def learn(self, positions: np.ndarray, agrees: bool) -> None:
        """Let a model be fitted to the frames so far; ``learned`` is called with it.

        Args:
            positions: present ones ``(N,)`` [rad].
            agrees: whether the model that there is explains what moves: it may stay.
        """
        if self.state is not BodyState.LEARNING:
            self.state = BodyState.LEARNING
            self._ask("learn", positions, str(Path(self._folder.name) / "body.npz"), agrees)

    def use(self, model: BodyModel) -> None:
        """Let the process take a model that is known already."""
        path = str(Path(self._folder.name) / "known.npz")
        model.save(path)
        self.state, self.sought_in_vain = BodyState.KNOWN, False
        self._ask("use", path)

    def follow(self, point: int, place: np.ndarray, number: int, frame: ProcessedFrame, J: np.ndarray) -> None:
        """Let a point be followed that is at ``place`` ``(2,)`` [px] in a frame, with J ``(H, W, 2, N)`` there."""
        self._ask("follow", point, place.copy(), number, frame.gray, frame.positions, J)

    def drop(self, point: int) -> None:
        """Let a point be followed no longer."""
        self._ask("drop", point)

    def forget_images(self) -> None:
        """Let it begin with new images: the clock of joint readings was found to be another."""
        self._forget_images("forget_images")

    def forget(self) -> None:
        """Let it forget the body and all points."""
        self.state, self.sought_in_vain = BodyState.UNKNOWN, False
        self._forget_images("forget")

    def answers(self) -> list[tuple[int, dict[int, SeenPoint | None]]]:
        """What was seen since last asked: frames' numbers, and points by theirs, None for one that is on no link."""
        return [self._answers.popleft() for _ in range(len(self._answers))]

    def end(self) -> None:
        """End the process."""
        with self._news:
            self._over = True
            self._news.notify_all()
        # Wakes both threads, and the process; a close alone wakes no thread that reads.
        with suppress(OSError), socket.socket(fileno=os.dup(self._connection.fileno())) as same:
            same.shutdown(socket.SHUT_RDWR)
        try:
            self._process.wait(END_SECONDS)
        except subprocess.TimeoutExpired:  # in the middle of a fit
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            thread.join(timeout=5)
        self._connection.close()
        self._folder.cleanup()

    def _forget_images(self, message: str) -> None:
        with self._news:
            self._leave_out([item for item in self._waiting if item[0] == "frame"])
            self.images, self._kept = 0, None
            self._ask(message)

    def _leave_out(self, frames: list[tuple[Any, ...]]) -> None:
        """Do not send some of the frames that wait."""
        for frame in frames:
            self._waiting.remove(frame)
            self.images -= frame[-1]

    def _ask(self, *message: Any) -> None:
        with self._news:
            if not self._over:
                self._waiting.append(message)
            self._news.notify_all()

    def _send(self) -> None:
        with suppress(OSError, ValueError):
            while True:
                with self._news:
                    self._news.wait_for(lambda: self._waiting or self._over)
                    if self._over:
                        return
                    message = self._waiting.popleft()
                    if message[0] == "frame":  # points are sought in the newest alone, or they would be ever later
                        message = (*message, not any(item[0] == "frame" for item in self._waiting))
                self._connection.send(message)

    def _receive(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                name, *values = self._connection.recv()
                if name == "learned":
                    self._take_model(*values)
                elif name == "seen":
                    self._answers.append((values[0], values[1]))
        self._lost()

    def _take_model(self, found: bool, path: str, told: str, in_vain: bool) -> None:
        model = None
        with suppress(DenseVSError):
            model = BodyModel.load(path) if found else None
        if self.state is BodyState.LEARNING:  # else it was forgotten meanwhile
            self.state = BodyState.NOT_FOUND if model is None else BodyState.KNOWN
            self.sought_in_vain = in_vain
            self._learned(model, told)

    def _lost(self) -> None:
        with self._news:
            self._over = True
            self._news.notify_all()
        if self.state is BodyState.LEARNING:
            self.state = BodyState.NOT_FOUND
            self._learned(None, "")
