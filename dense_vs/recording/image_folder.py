"""A folder of images with a CSV joint log, as many scripts write it.

The images' times come from the first of these that is there: a column ``image`` of the log that names each row's file;
file names that are times within the log [s, ms, us or ns]; as many images as rows, in the order of their names.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.recording.frame import ImageStream, rate_of
from dense_vs.recording.joint_log import IMAGE_COLUMN, JointLog, csv_rows
from dense_vs.recording.stored_image import read_image

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # s of a file name's number


class ImageFolder:
    """A :class:`~dense_vs.recording.RecordingFormat` of one camera and one episode.

    Args:
        path: the folder.
        images: its image files.
        joint_log: CSV file, see :meth:`JointLog.read_csv`.

    Raises:
        DenseVSError: a log that cannot be read, or no way to tell the images' times.
    """

    name = "folder of images and joint log"
    episodes: tuple[int, ...] = (0,)

    def __init__(self, path: Path, images: Sequence[Path], joint_log: Path):
        self.path = path
        self.cameras = (path.name or "images",)
        self._log = JointLog.read_csv(joint_log)
        self.joint_names = self._log.names
        ordered = sorted(images, key=_by_value)
        self._files = _by_column(path, ordered, joint_log, self._log) or _by_name(ordered, self._log)
        if self._files is None and len(images) == len(self._log.times):
            self._files = list(zip(ordered, self._log.times.tolist(), strict=True))
        if not self._files:
            raise DenseVSError(
                f"times of the {len(images)} images in {path} are not known: expected a column {IMAGE_COLUMN!r} with "
                f"file names in {joint_log}, or file names that are times within it, or one image for each of its "
                f"{len(self._log.times)} rows"
            )

    def log(self, episode: int) -> JointLog:
        """All joints."""
        return self._log

    def images(self, episode: int, camera: str) -> ImageStream:
        """The images in the order of their times."""
        return _ImageFiles(self._files or [])


class _ImageFiles:
    def __init__(self, files: Sequence[tuple[Path, float]]):
        self._files = files
        first = read_image(files[0][0], f"image {files[0][0]}")
        self.height, self.width = first.shape[:2]
        self.fps = rate_of([time for _, time in files]) or 30.0
        self.frame_count, self.start = len(files), files[0][1]

    def __iter__(self) -> Iterator[tuple[np.ndarray, float]]:
        for file, time in self._files:
            image = read_image(file, f"image {file}")
            if image.shape[:2] != (self.height, self.width):
                raise DenseVSError(
                    f"image {file} has {image.shape[1]} x {image.shape[0]} pixels; expected {self.width} x "
                    f"{self.height} as the images before"
                )
            yield image, time


def _by_value(file: Path) -> list[int | str]:
    """Numbers in names count by value: image_9 comes before image_10."""
    parts = re.split("([0-9]+)", file.name)  # every second one is a number, of digits that int() takes
    return [int(part) if place % 2 else part for place, part in enumerate(parts)]


def _by_column(path: Path, images: Sequence[Path], joint_log: Path, log: JointLog) -> list[tuple[Path, float]] | None:
    rows = csv_rows(joint_log)
    header = [cell.strip() for cell in rows[0]]
    if IMAGE_COLUMN not in header:
        return None
    column, present = header.index(IMAGE_COLUMN), {file.name: file for file in images}
    found = []
    for row, time in zip(rows[1:], log.times.tolist(), strict=True):
        name = row[column].strip()
        if not name:  # joints are often read more often than the camera
            continue
        if name not in present:
            raise DenseVSError(f"image {name!r} of {joint_log} is not in {path}; it has {len(images)} images")
        found.append((present[name], time))
    return found


def _by_name(images: Sequence[Path], log: JointLog) -> list[tuple[Path, float]] | None:
    try:
        numbers = np.array([float(file.stem) for file in images])
    except ValueError:
        return None
    steps = np.diff(numbers)
    if np.any(steps <= 0) or (np.all(steps == steps[0]) and steps[0] in (1, 2, 5, 10, 100)):  # a counter
        return None
    margin = 1.0  # s; a camera may have started before the log
    for unit in UNITS:
        times = numbers * unit
        inside = (times >= log.times[0] - margin) & (times <= log.times[-1] + margin)
        if inside.mean() > 0.5 and rate_of(times) >= 2:  # a camera of fewer images a second shows no motion
            return list(zip(images, times.tolist(), strict=True))
    return None
