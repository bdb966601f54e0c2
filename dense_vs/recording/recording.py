"""A recording as the user sees it: its cameras, joints and episodes, and the frames of the chosen ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np

from dense_vs.checks import check_names, check_number, shown
from dense_vs.errors import DenseVSError
from dense_vs.files import short_text
from dense_vs.recording.clock_offset import ClockOffset
from dense_vs.recording.frame import ImageStream, RecordedFrame, RecordingFormat
from dense_vs.recording.joint_log import JointLog

MEMBERS = ("path", "name", "cameras", "joint_names", "episodes", "log", "images")  # of a RecordingFormat
STAMP_ROUNDING = 1e-4  # s; a log that ends with a frame, its stamps rounded, still covers that frame


@dataclass
class Episode:
    """One take: the images of a camera and the joints with them.

    Images stream, so memory does not grow with their number; the joint log is held, 8 bytes a joint and reading.

    Attributes:
        number: of the episode.
        camera: its name.
        log: the chosen joints, on the camera's clock as far as it is known.
        source: where the images come from.
        skipped_frames: images outside the log that the last iteration left out.
    """

    number: int
    camera: str
    log: JointLog
    source: RecordingFormat
    skipped_frames: int = field(default=0, compare=False)

    def images(self) -> ImageStream:
        """A new stream of the episode's images."""
        return self.source.images(self.number, self.camera)

    def shifted(self, offset: float | ClockOffset) -> "Episode":
        """The episode with its joint log moved onto the camera's clock.

        Args:
            offset: seconds added to the log's times [s], or what :func:`find_clock_offset` found.

        Raises:
            DenseVSError: an offset that is not a finite number.
        """
        if isinstance(offset, ClockOffset):
            return replace(self, log=offset.applied(self.log))
        return replace(self, log=self.log.shifted(check_number("time_offset", offset)))

    def __iter__(self) -> Iterator[RecordedFrame]:
        """Every image within the log and the joints at its time; others count in ``skipped_frames``.

        Raises:
            DenseVSError: fewer than two images within the log, or a damaged file, at that point.
        """
        self.skipped_frames = 0
        images = self.images()
        self.check_overlap(images)
        first, last = self.log.times[0], self.log.times[-1]
        used, begin, end = 0, np.inf, -np.inf
        for image, time in images:
            begin, end = min(begin, time), max(end, time)
            if not first - STAMP_ROUNDING <= time <= last + STAMP_ROUNDING:
                self.skipped_frames += 1
                continue
            used += 1
            yield RecordedFrame(image, time, self.log.at(np.clip([time], first, last))[0])
        if used < 2:
            raise self._apart(begin, end)

    def check_overlap(self, images: ImageStream) -> None:
        """Refuse clocks that are apart, before the first image is used.

        Raises:
            DenseVSError: the images, as far as their number is known, all lie outside the log.
        """
        seconds = images.frame_count / images.fps if images.frame_count and images.fps else np.inf
        if self.log.times[-1] < images.start or self.log.times[0] > images.start + seconds:
            raise self._apart(images.start, images.start + seconds)

    def _apart(self, begin: float, end: float) -> DenseVSError:
        return DenseVSError(
            f"camera {self.camera} covers {begin:.3f} to {end:.3f} s and the joint log {self.log.times[0]:.3f} to "
            f"{self.log.times[-1]:.3f} s; expected at least two frames within the log (is --time-offset right?)"
        )


class Recording:
    """Episodes of a robot before cameras, whatever format they are stored in; made by :func:`open_recording`.

    Iterating gives the :class:`RecordedFrame` of every image of the chosen episode.

    Args:
        source: the format.
        episode: the chosen one; the first unless given.
        camera: its name; the first unless given.
        joint_names: names or patterns as ``kRight*``; all joints unless given.

    Attributes:
        cameras: names of all cameras.
        joint_names: names of the chosen joints.
        episodes: numbers of all episodes that are there.
        camera: name of the chosen camera.

    Raises:
        DenseVSError: a source that is no format, or an episode, camera or joint that is not there.
    """

    def __init__(
        self,
        source: RecordingFormat,
        *,
        episode: int | None = None,
        camera: str | None = None,
        joint_names: Sequence[str] | None = None,
    ):
        missing = [member for member in MEMBERS if not hasattr(source, member)]
        if missing:
            raise DenseVSError(
                f"source is a {type(source).__name__} without {', '.join(missing)}; expected a RecordingFormat, as "
                "open_recording() makes one"
            )
        if not source.cameras or not source.episodes:
            raise DenseVSError(f"{source.path} has no camera or no episode; expected at least one of each")
        self.source = source
        self.path, self.format = source.path, source.name
        self.cameras, self.episodes = source.cameras, source.episodes
        if camera is not None and not (isinstance(camera, str) and camera in self.cameras):
            present = short_text(", ".join(self.cameras))
            raise DenseVSError(f"camera {shown(camera)} is not in {self.path}; it has {present}")
        self.camera = camera or self.cameras[0]
        self.all_joint_names = source.joint_names
        self.joint_names = choose_names(joint_names, source.joint_names)
        self._chosen = self.episodes[0] if episode is None else episode
        self._check(self._chosen)

    def episode(self, number: int | None = None) -> Episode:
        """An episode with the chosen camera and joints; the chosen one unless given.

        Raises:
            DenseVSError: no such episode, or its joints cannot be read.
        """
        number = self._chosen if number is None else number
        self._check(number)
        log = self.source.log(number)
        return Episode(number, self.camera, log.select(self.joint_names), self.source)

    def __iter__(self) -> Iterator[RecordedFrame]:
        """The frames of the chosen episode, see :class:`Episode`."""
        return iter(self.episode())

    def _check(self, number: int) -> None:
        whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
        if not whole or number not in self.episodes:
            present = short_text(_ranges(self.episodes))
            raise DenseVSError(f"episode {shown(number)} is not in {self.path}; it has {present}")


def choose_names(patterns: Sequence[str] | None, names: Sequence[str]) -> tuple[str, ...]:
    """Names that the patterns choose, in the patterns' order; all of them for None.

    Raises:
        DenseVSError: no sequence of names, a pattern that chooses none, or a name that is chosen twice by name.
    """
    if patterns is None:
        return tuple(names)
    if isinstance(patterns, (list, tuple)) and not patterns:
        raise DenseVSError("joints are none; expected at least one name")
    chosen: list[str] = []
    for pattern in check_names("joint names", patterns):
        found = [name for name in names if name == pattern or fnmatchcase(name, pattern)]
        if not found:
            raise DenseVSError(
                f"joint {shown(pattern)} is not in the log; expected one of {short_text(', '.join(names))}"
            )
        if pattern in chosen:
            raise DenseVSError(f"joint {shown(pattern)} is named twice; expected each name once")
        chosen += [name for name in found if name not in chosen]
    return tuple(chosen)


def _ranges(numbers: Sequence[int]) -> str:
    """``0-4, 7`` for 0, 1, 2, 3, 4, 7."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in parts)
