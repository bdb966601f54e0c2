"""Writers of recordings: video and joint log, LeRobot v3.0, and ROS 2 bags in MCAP. One protocol, chosen by name."""

import csv
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import numpy as np

from dense_vs.checks import check_choice, check_number, shown
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, file_path, output_folder
from dense_vs.recording.joint_log import IMAGE_COLUMN
from dense_vs.recording.joint_readings import JointReadings
from dense_vs.recording.video_writer import VideoWriter
from dense_vs.recording.writer_checks import check_open, recorded_names

FORMATS = ("video", "lerobot", "mcap")
QUALITY = 12  # constant rate factor that keeps texture for optical flow


class RecordingWriter(Protocol):
    """Takes images and joint readings in any interleaving; files are complete after :meth:`close`.

    After :meth:`close` or :meth:`abort` nothing can be added, and either does nothing more.
    """

    def add_image(self, image: np.ndarray, time: float) -> None:
        """Add an RGB uint8 ``(H, W, 3)`` image and its stamp [s].

        Raises:
            DenseVSError: no such image, a stamp that is not a finite number, or a writer that is closed; it is left
                out.
        """
        ...

    def add_joints(self, positions: np.ndarray, time: float) -> None:
        """Add joint positions ``(N,)`` and their stamp [s].

        Raises:
            DenseVSError: not N finite numbers, a stamp that is none, or a writer that is closed; the reading is left
                out.
        """
        ...

    def close(self) -> None:
        """Complete the files.

        Raises:
            DenseVSError: no image, fewer than two joint readings, or a full disk; no files are left then.
        """
        ...

    def abort(self) -> None:
        """Leave no files of what is not complete."""
        ...


def open_writer(
    form: str,
    path: str | os.PathLike[str],
    joint_names: tuple[str, ...],
    *,
    fps: float = 30.0,
    quality: int = QUALITY,
) -> RecordingWriter:
    """A writer of a recording.

    Args:
        form: ``"video"`` (video.mp4 and joints.csv), ``"lerobot"`` (LeRobot v3.0) or ``"mcap"`` (a ROS 2 bag).
        path: folder, made here; new or empty but for ``"video"``.
        joint_names: N names.
        fps: images a second, in the formats that store one [Hz].
        quality: constant rate factor of H.264, lower is better.

    Raises:
        DenseVSError: another format, no names or two alike, a rate or quality out of range, or a folder that cannot be
            written to.
    """
    check_choice("format", form, FORMATS)
    joint_names = recorded_names(joint_names)
    path = file_path(path)
    if form == "video":
        return VideoAndLogWriter(output_folder(path), joint_names, fps=fps, quality=quality)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise DenseVSError(f"{path} is there already; expected a new or empty folder")
    if form == "lerobot":
        from dense_vs.recording.lerobot_writer import LeRobotWriter

        return LeRobotWriter(path, joint_names, fps=fps, quality=quality)
    from dense_vs.recording.ros_bag_writer import RosBagWriter

    return RosBagWriter(path, joint_names)


@contextmanager
def written(writer: RecordingWriter) -> Iterator[None]:
    """Closes a writer at the end of the block, also one that was interrupted; any other error leaves no recording."""
    try:
        yield
    except KeyboardInterrupt:
        writer.close()
        raise
    except BaseException:
        writer.abort()
        raise
    writer.close()


class VideoAndLogWriter:
    """video.mp4 and joints.csv; image stamps are multiples of 1 / fps from 0, and the log's times count from there.

    Args:
        folder: where to write.
        joint_names: N names.
        fps, quality: of :class:`VideoWriter`.

    Raises:
        DenseVSError: names that the log has no room for, or as :class:`VideoWriter`.
    """

    def __init__(self, folder: Path, joint_names: tuple[str, ...], *, fps: float, quality: int):
        self._folder, self._names = folder, recorded_names(joint_names)
        for name in self._names:
            if name == IMAGE_COLUMN or name != name.strip():
                raise DenseVSError(
                    f"joint name {shown(name)} does not come back from a joint log; expected a name without space "
                    f"around it, other than {IMAGE_COLUMN!r}, which is the column of images' names"
                )
        self._closed = False
        self._video = VideoWriter(folder / "video.mp4", fps, quality=quality)
        self._joints = JointReadings(joint_names)
        self._start: float | None = None

    def add_image(self, image: np.ndarray, time: float) -> None:
        """Add an image."""
        check_open(self._closed, self._folder)
        time = check_number("image time stamp", time)
        self._video.write(image)
        self._start = time if self._start is None else self._start

    def add_joints(self, positions: np.ndarray, time: float) -> None:
        """Add a reading; one that is not newer than the last is the same reading again."""
        check_open(self._closed, self._folder)
        self._joints.add(positions, time)

    def close(self) -> None:
        """Complete both files."""
        if self._closed:
            return
        if len(self._joints) < 2:
            self.abort()
            raise DenseVSError(f"{self._folder} got {len(self._joints)} joint readings; expected at least 2")
        self._closed = True
        self._video.__exit__(None)
        with atomic_write(self._folder / "joints.csv", "w") as stream:
            rows = csv.writer(stream, lineterminator="\n")
            rows.writerow(["time", *self._names])
            for time, row in zip(self._joints.times, self._joints.positions, strict=True):
                rows.writerow([f"{time - (self._start or 0.0):.6f}", *(f"{q:.8f}" for q in row)])

    def abort(self) -> None:
        """Leave no video."""
        self._closed = True
        self._video.__exit__(KeyboardInterrupt)
