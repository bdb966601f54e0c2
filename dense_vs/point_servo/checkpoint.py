"""What a loop has learned, kept in a file while it runs: a process that was killed goes on from there.

The file is one that :meth:`DenseJacobian.load` reads, with the joints' names, where they were, how long the robot has
moved to learn it, and the body model where nothing speaks against it. It is replaced every few seconds, whole or not at
all, by a thread of its own, so that no image waits for a disk.
"""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from threading import Thread
from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.body_model import BodyModel
from dense_vs.body_model.model_file import NAMES as BODY_NAMES
from dense_vs.checks import check_names, check_number, check_pair, shown
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, check_writable, file_path, read_arrays, short_text, stored_array
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.point_servo.loop import ServoLoop

PERIOD = 3.0  # s between two writings
STEP_PX = 1.0  # image motion by which J is brought to another posture at a time
MOST_STEPS = 300
BODY = "body_"  # before the names of a body's arrays


@dataclass(frozen=True)
class Kept:
    """What a checkpoint holds.

    Attributes:
        estimator: as it was.
        positions: ``(N,)`` of the joints that its J is of [rad, m].
        seconds: that the robot had moved to learn it.
        body: model of the robot; None where none was known, or something spoke against it.
    """

    estimator: DenseJacobian
    positions: np.ndarray
    seconds: float
    body: BodyModel | None = None

    def bring_to(self, positions: Any) -> None:
        """Move J with the image to where the joints are now ``(N,)``: a robot may have sagged or been moved meanwhile.

        By DIJE (14), a pixel at a time; what moved in front of something else has to be learned anew there.

        Raises:
            DenseVSError: not N finite numbers.
        """
        q = real_vector(positions, "positions", self.positions.shape)
        way = np.where(self.estimator.learned, q - self.positions, 0.0)
        flow = np.abs(self.estimator.predicted_flow(way)).max(axis=2)
        moving = flow[flow > 0.1 * flow.max(initial=0.0)]
        far = float(np.quantile(moving, 0.95)) if moving.size else 0.0
        steps = min(int(np.ceil(far / STEP_PX)), MOST_STEPS)
        for _ in range(steps):
            self.estimator.predict(way / steps)


class Checkpoint:
    """A file that :meth:`keep` brings up to date while a loop runs.

    Args:
        path: of the file.
        joint_names: of the N joints, in their order.
        period: time between two writings [s].

    Raises:
        DenseVSError: a file that cannot be written, or names that it cannot hold.
    """

    def __init__(self, path: str | os.PathLike[str], joint_names: Sequence[str], *, period: float = PERIOD):
        self.path = file_path(path)
        check_writable(self.path)
        self.joint_names = check_names("joint_names", joint_names)
        if tuple(np.array(self.joint_names).tolist()) != self.joint_names:  # null characters at an end are lost
            raise DenseVSError(f"joint_names is {shown(self.joint_names)}; expected names that a file can hold")
        self.period = check_number("period", period, above=0)
        self._written = -np.inf
        self._thread: Thread | None = None
        self._error: DenseVSError | None = None

    def resume(self, size: tuple[int, int], *, device: str = "auto", threads: int | None = None) -> Kept | None:
        """What the file holds; None where there is none.

        Args:
            size: (height, width) of the estimator's images [px].
            device, threads: as of :class:`DenseJacobian`.

        Raises:
            DenseVSError: a file that is no checkpoint, or one of other images or joints.
        """
        size = check_pair("size", size, least=1, most=1 << 24)
        if not self.path.exists():
            return None
        what = "a checkpoint"
        body_names = [BODY + name for name in BODY_NAMES]
        arrays = read_arrays(self.path, what, ("joint_names", "positions", "seconds", *body_names))
        try:
            names = tuple(str(name) for name in stored_array(arrays, "joint_names", (-1,), "U"))
            positions = np.array(stored_array(arrays, "positions", (len(names),)), dtype=np.float64)
            seconds = check_number("seconds", stored_array(arrays, "seconds", ()).item(), least=0)
        except DenseVSError as error:
            raise DenseVSError(f"{self.path} is not {what}: {error}") from error
        if names != self.joint_names:
            raise DenseVSError(
                f"{self.path} is of the joints {', '.join(names)}; expected {', '.join(self.joint_names)}, or "
                "another file"
            )
        estimator = DenseJacobian.load(self.path, device=device, threads=threads)
        options = estimator.options
        found = options.height, options.width, options.joints, options.worlds
        if found != (*size, len(names), 1):
            raise DenseVSError(
                f"{self.path} has height, width, joints, worlds {found}; expected {(*size, len(names), 1)}, or another "
                "file"
            )
        stored = {name.removeprefix(BODY): array for name, array in arrays.items() if name.startswith(BODY)}
        body = BodyModel.of_stored(stored, self.path) if stored else None
        if body is not None and (body.joint_count, tuple(body.size)) != (len(names), size):
            raise DenseVSError(
                f"{self.path} is damaged: its body has {body.joint_count} joints and images of {tuple(body.size)}; "
                f"expected {len(names)} and {size}"
            )
        return Kept(estimator, positions, seconds, body)

    def keep(self, loop: ServoLoop, seconds: float) -> None:
        """Write what a loop knows now, if it is time; to be called after every frame.

        Args:
            loop: whose J and body it is.
            seconds: that the robot has moved to learn it.

        Raises:
            DenseVSError: the last writing failed, as on a full disk; or what :meth:`resume` would refuse: another
                number of joints, a posture that is not finite, no such seconds. The file stays as it was.
        """
        self._raise_failure()
        seconds = check_number("seconds", seconds, least=0)
        estimator = getattr(loop, "estimator", None)
        if not isinstance(estimator, DenseJacobian):
            raise DenseVSError(f"loop is a {type(loop).__name__}; expected a ServoLoop")
        joints, worlds = estimator.options.joints, estimator.options.worlds
        if (joints, worlds) != (len(self.joint_names), 1):
            raise DenseVSError(
                f"estimator has {joints} joints in {worlds} worlds; expected {len(self.joint_names)} in one, of "
                f"{short_text(', '.join(self.joint_names))}"
            )
        posture = real_vector(loop.pipeline.posture, "posture", (joints,))
        now = time.monotonic()
        if now - self._written < self.period or (self._thread is not None and self._thread.is_alive()):
            return
        self._written = now
        # Copies, as the estimator goes on while they are written.
        content = {name: np.array(value) for name, value in estimator.stored().items()}
        content |= {
            "joint_names": np.array(self.joint_names),
            "positions": posture,
            "seconds": np.array(seconds),
        }
        if (body := loop.learned_body.believed) is not None:
            content |= {BODY + name: np.asarray(array) for name, array in body.stored().items()}
        self._thread = Thread(target=self._write, args=(content,), name="checkpoint")
        self._thread.start()

    def end(self) -> None:
        """Wait for a write that is under way."""
        if self._thread is not None:
            self._thread.join()

    def finish(self) -> None:
        """Wait for a write that is under way, and say whether it was done; to be called when the loop ends.

        Raises:
            DenseVSError: the last writing failed.
        """
        self.end()
        self._raise_failure()

    def _raise_failure(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _write(self, content: dict[str, np.ndarray]) -> None:
        try:
            with atomic_write(self.path) as stream:
                np.savez(stream, allow_pickle=False, **content)
        except DenseVSError as error:
            self._error = error
        except Exception as error:  # in this thread nobody would hear of it
            self._error = DenseVSError(f"cannot write {self.path}: {type(error).__name__}: {short_text(str(error))}")
