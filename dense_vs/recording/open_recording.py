"""Opens a recording by what is found at a path, whatever wrote it."""

import os
from collections.abc import Sequence
from pathlib import Path

from dense_vs.errors import DenseVSError
from dense_vs.files import file_path
from dense_vs.recording.frame import RecordingFormat
from dense_vs.recording.recording import Recording

ACCEPTED = (
    "a video file with a CSV joint log, a LeRobot folder (meta/info.json), a ROS bag (.bag, .mcap, .db3 or a folder "
    "with metadata.yaml), or a folder of images with a CSV joint log"
)
BAGS = (".bag", ".mcap", ".db3")


def open_recording(
    path: str | os.PathLike[str],
    joint_log: str | os.PathLike[str] | None = None,
    *,
    episode: int | None = None,
    camera: str | None = None,
    joint_names: Sequence[str] | None = None,
) -> Recording:
    """Open a recording; its format follows from what is found at ``path``.

    Args:
        path: video file, LeRobot folder (v2.0, v2.1, v3.0), ROS 1 or ROS 2 bag, or folder of images.
        joint_log: CSV file with the joints of a video or a folder of images, see :meth:`JointLog.read_csv`; one beside
            or in it unless given.
        episode, camera, joint_names: see :class:`Recording`.

    Raises:
        DenseVSError: nothing there that can be used, or a choice that is not in it.
    """
    try:
        source = _format(file_path(path), None if joint_log is None else file_path(joint_log))
    except OSError as error:  # a folder that may not be looked into
        raise DenseVSError(f"cannot read {path}: {error.strerror or error}") from error
    if not source.cameras:
        raise DenseVSError(f"{source.name} {path} has no camera; expected images or video in it")
    if not source.episodes:
        raise DenseVSError(f"{source.name} {path} has no episode whose files are all there")
    return Recording(source, episode=episode, camera=camera, joint_names=joint_names)


def _format(path: Path, joint_log: Path | None) -> RecordingFormat:
    from dense_vs.recording.image_folder import IMAGE_SUFFIXES, ImageFolder
    from dense_vs.recording.video_and_log import VideoAndLog

    if not path.exists():
        raise DenseVSError(f"{path} does not exist; expected {ACCEPTED}")
    if not path.is_dir():
        if path.suffix.lower() in BAGS:
            return _bag(path, joint_log)
        if joint_log is None:
            beside = [path.with_suffix(".csv"), path.with_name("joints.csv")]
            joint_log = next((log for log in beside if log.is_file()), None)
        if joint_log is None:
            raise DenseVSError(f"video {path} comes without a joint log; expected a CSV file as the second argument")
        return VideoAndLog(path, joint_log)
    if (path / "meta" / "info.json").is_file():
        from dense_vs.recording.lerobot_folder import LeRobotFolder

        _no_log(path, joint_log)
        return LeRobotFolder(path)
    files = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    bags = [file for file in files if file.suffix.lower() in BAGS]
    if (path / "metadata.yaml").is_file():
        return _bag(path, joint_log)
    if len(bags) == 1:
        return _bag(bags[0], joint_log)
    if len(bags) > 1:
        raise DenseVSError(f"{path} holds {len(bags)} bags; expected the path of one of them, as {bags[0]}")
    logs = [file for file in files if file.suffix.lower() == ".csv"]
    if joint_log is None and len(logs) == 1:
        joint_log = logs[0]
    images = [file for file in files if file.suffix.lower() in IMAGE_SUFFIXES]
    videos = [file for file in files if file.suffix.lower() in (".mp4", ".mkv", ".avi", ".mov", ".webm")]
    if (images or len(videos) == 1) and joint_log is None:
        raise DenseVSError(f"{path} holds {len(logs)} CSV files; expected one, or the joint log as the second argument")
    if len(images) > 1 and joint_log is not None:
        return ImageFolder(path, images, joint_log)
    if len(videos) == 1 and joint_log is not None:
        return VideoAndLog(videos[0], joint_log)
    raise DenseVSError(f"{path} is a folder that holds no recording; expected {ACCEPTED}")


def _bag(path: Path, joint_log: Path | None) -> RecordingFormat:
    from dense_vs.recording.ros_bag import RosBag

    _no_log(path, joint_log)
    return RosBag(path)


def _no_log(path: Path, joint_log: Path | None) -> None:
    if joint_log is not None:
        raise DenseVSError(f"{path} holds its own joints; expected no joint log beside it, got {joint_log}")
