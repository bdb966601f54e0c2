"""A video file and a CSV joint log: the simplest recording, one episode of one camera."""

from pathlib import Path

from dense_vs.recording.frame import ImageStream
from dense_vs.recording.joint_log import JointLog
from dense_vs.recording.video_reader import VideoReader


class VideoAndLog:
    """A :class:`~dense_vs.recording.RecordingFormat`.

    Args:
        video: file, see :class:`VideoReader`.
        joint_log: CSV file, see :meth:`JointLog.read_csv`.

    Raises:
        DenseVSError: a file that cannot be used.
    """

    name = "video and joint log"
    cameras: tuple[str, ...] = ("video",)
    episodes: tuple[int, ...] = (0,)

    def __init__(self, video: Path, joint_log: Path):
        self.path = video
        VideoReader(video)  # a bad video is named before the log is read
        self._log = JointLog.read_csv(joint_log)
        self.joint_names = self._log.names

    def log(self, episode: int) -> JointLog:
        """All joints."""
        return self._log

    def images(self, episode: int, camera: str) -> ImageStream:
        """The video's images, from its beginning."""
        return VideoReader(self.path)
