"""A recording behind the Camera and Robot protocols: a loop that runs on a robot runs on what was recorded of it."""

from collections.abc import Iterator

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.errors import DenseVSError
from dense_vs.recording.frame import RecordedFrame
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.prefetch import prefetch
from dense_vs.recording.recording import Episode, Recording


class Replay:
    """Camera and robot in one; commands are taken and not followed, as what happened cannot be changed.

    Args:
        recording: the episode, or a recording whose chosen episode is replayed.

    Attributes:
        joint_names: N names.
        joint_limits: None, as a recording says nothing of them.
        commands: commands taken so far.

    Raises:
        DenseVSError: neither of these.
    """

    def __init__(self, recording: Recording | Episode):
        episode = recording.episode() if isinstance(recording, Recording) else recording
        if not isinstance(getattr(episode, "log", None), JointLog) or not hasattr(episode, "__iter__"):
            raise DenseVSError(f"recording is a {type(recording).__name__}; expected a Recording or an Episode")
        self.joint_names = episode.log.names
        self.joint_limits: np.ndarray | None = None
        self.commands = 0
        self._log = episode.log
        self._frames: Iterator[RecordedFrame] = prefetch(episode)
        self._frame: RecordedFrame | None = None

    def read(self) -> tuple[np.ndarray, float]:
        """The next image and its time [s].

        Raises:
            DenseVSError: the recording is over.
        """
        frame = next(self._frames, None)
        if frame is None:
            raise DenseVSError("the recording is over; expected fewer frames to be read")
        self._frame = frame
        return frame.image, frame.time

    def joints(self) -> tuple[np.ndarray, float]:
        """Joint positions ``(N,)`` at the time of the last image; the first reading before any."""
        if self._frame is None:
            return self._log.positions[0].copy(), float(self._log.times[0])
        return self._frame.joints, self._frame.time

    def command(self, delta: np.ndarray) -> None:
        """Take a command ``(N,)``.

        Raises:
            DenseVSError: not N finite numbers.
        """
        real_vector(delta, "delta", (len(self.joint_names),))
        self.commands += 1
