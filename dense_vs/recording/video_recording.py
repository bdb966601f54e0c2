"""A recording: a video and a joint log with clocks that need aligning."""

import os
from collections.abc import Iterator, Sequence

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.video import VideoReader

STAMP_ROUNDING = 1e-4  # s; a log that ends with a frame, its stamps rounded, still covers that frame


class Recording:
    """A video and the joint log recorded with it.

    Args:
        video: file that OpenCV reads.
        joints: CSV file, see :meth:`JointLog.read_csv`.
        joint_names: which joints of the log to use; all unless given.
        time_offset: seconds added to the log's times to bring them onto the video's clock [s].

    Raises:
        DenseVSError: a file that cannot be used, or clocks that do not overlap.
    """

    def __init__(
        self,
        video: str | os.PathLike[str],
        joints: str | os.PathLike[str],
        *,
        joint_names: Sequence[str] | None = None,
        time_offset: float = 0.0,
    ):
        if not np.isfinite(time_offset):
            raise DenseVSError(f"time_offset is {time_offset}; expected finite seconds")
        log = JointLog.read_csv(joints)
        self.log = (log.select(joint_names) if joint_names is not None else log).shifted(time_offset)
        self.video = VideoReader(video)
        self.skipped_frames = 0
        seconds = self.video.frame_count / self.video.fps if self.video.frame_count else np.inf
        if self.log.times[-1] < self.video.start or self.log.times[0] > self.video.start + seconds:
            raise self._apart(self.video.start, self.video.start + seconds)

    def __iter__(self) -> Iterator[tuple[np.ndarray, float, np.ndarray]]:
        """Every image within the log, its time [s] and the joint positions ``(N,)`` then.

        Frames before the log begins and after it ends are counted in ``skipped_frames`` and left out.

        Raises:
            DenseVSError: fewer than two frames within the log, at the end.
        """
        first, last = self.log.times[0], self.log.times[-1]
        used, begin, end = 0, np.inf, -np.inf
        for image, time in self.video:
            begin, end = min(begin, time), max(end, time)
            if not first - STAMP_ROUNDING <= time <= last + STAMP_ROUNDING:
                self.skipped_frames += 1
                continue
            used += 1
            yield image, time, self.log.at(np.clip([time], first, last))[0]
        if used < 2:
            raise self._apart(begin, end)

    def _apart(self, begin: float, end: float) -> DenseVSError:
        return DenseVSError(
            f"video covers {begin:.3f} to {end:.3f} s and the joint log {self.log.times[0]:.3f} to "
            f"{self.log.times[-1]:.3f} s; expected at least two frames within the log (is --time-offset right?)"
        )
