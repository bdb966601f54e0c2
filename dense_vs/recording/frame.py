"""Parts of a recording: frames, the stream of a camera's images, and the protocol of a format."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.recording.joint_log import JointLog

MAX_PIXELS = 1 << 26  # of an image; more is a damaged file, and is refused before memory is taken for it


@dataclass(frozen=True)
class RecordedFrame:
    """An image of a recording and the joints at its time.

    Attributes:
        image: RGB uint8 ``(H, W, 3)``.
        time: its stamp [s].
        joints: ``(N,)`` joint positions, interpolated to it, in the units that the recording has them in.
    """

    image: np.ndarray
    time: float
    joints: np.ndarray


class ImageStream(Protocol):
    """The images of one camera, once, in order.

    Attributes:
        height, width: image size [px].
        fps: nominal image rate [Hz].
        frame_count: number of images where it is known beforehand, else 0.
        start: time of the first image [s].
    """

    height: int
    width: int
    fps: float
    frame_count: int
    start: float

    def __iter__(self) -> Iterator[tuple[np.ndarray, float]]:
        """RGB uint8 ``(H, W, 3)`` and time [s] of every image."""
        ...


class RecordingFormat(Protocol):
    """A recording as one format stores it; made without reading images.

    Attributes:
        path: file or folder.
        name: of the format, for the user.
        cameras: names of the cameras.
        joint_names: names of all joints.
        episodes: numbers of the episodes that are there.
    """

    path: Path
    name: str
    cameras: tuple[str, ...]
    joint_names: tuple[str, ...]
    episodes: tuple[int, ...]

    def log(self, episode: int) -> JointLog:
        """All joints of an episode."""
        ...

    def images(self, episode: int, camera: str) -> ImageStream:
        """The images of an episode, from its beginning."""
        ...


def check_size(width: int, height: int, what: str) -> None:
    """Refuse an image of a size that no camera has.

    Raises:
        DenseVSError: no pixel, or more than 67 million.
    """
    if not (width > 0 and height > 0 and width * height <= MAX_PIXELS):
        raise DenseVSError(f"{what} has {width} x {height} pixels; expected 1 to {MAX_PIXELS} pixels")


def rate_of(times: Sequence[float] | np.ndarray) -> float:
    """Images or readings a second, from the median of the steps between their stamps [Hz]; 0 for fewer than two."""
    steps = np.diff(np.asarray(times, dtype=np.float64))
    steps = steps[steps > 0]
    return float(1 / np.median(steps)) if steps.size else 0.0
