"""Video files in and out: any that OpenCV reads, H.264 out."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError


class VideoReader:
    """The frames of a video file with their time stamps, a :class:`dense_vs.Camera` of the past.

    Args:
        path: any file that OpenCV reads.

    Attributes:
        height, width: frame size [px].
        fps: nominal frame rate [Hz].
        frame_count: number of frames that the container states, 0 where it does not.
        start: time of the first frame [s].

    Raises:
        DenseVSError: missing, not a video, or without a single frame.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        if not self.path.is_file():
            raise DenseVSError(f"video {self.path} does not exist")
        # FFmpeg would write its own line about a bad file to stderr; OpenCV reads this once, before its first file.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        log_level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            self._capture = cv2.VideoCapture(str(self.path))
        finally:
            cv2.utils.logging.setLogLevel(log_level)
        if not self._capture.isOpened():
            raise DenseVSError(f"video {self.path} cannot be opened; expected a file that OpenCV reads")
        self.fps = float(self._capture.get(cv2.CAP_PROP_FPS)) or 30.0
        self.frame_count = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        self._time: float | None = None
        self._first = self._next()
        if self._first is None:
            raise DenseVSError(f"video {self.path} has no frame that can be read; is it truncated?")
        self.height, self.width = self._first[0].shape[:2]
        self.start = self._first[1]

    def __iter__(self) -> Iterator[tuple[np.ndarray, float]]:
        """RGB uint8 ``(H, W, 3)`` and time [s] of every frame, once; the first is at the container's first stamp.

        Raises:
            DenseVSError: the frame size changes.
        """
        frame, self._first = self._first, None
        while frame is not None:
            if frame[0].shape[:2] != (self.height, self.width):
                raise DenseVSError(
                    f"video {self.path} changes its frame size from {self.width} x {self.height} to "
                    f"{frame[0].shape[1]} x {frame[0].shape[0]} at {frame[1]:.3f} s"
                )
            yield frame
            frame = self._next()

    def _next(self) -> tuple[np.ndarray, float] | None:
        read, image = self._capture.read()
        if not read:
            return None
        stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if self._time is not None and stamp <= self._time:  # a container without stamps: count frames
            stamp = self._time + 1 / self.fps
        self._time = stamp
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB), stamp


class VideoWriter:
    """Writes RGB frames as H.264 in an MP4 file, which browsers and OpenCV play; use as a context manager.

    The file takes its name when it is complete; an error leaves none.

    Args:
        path: of the file.
        fps: frame rate [Hz].
        quality: constant rate factor, lower is better; 12 keeps texture for optical flow, 20 is for viewing.

    Raises:
        DenseVSError: PyAV is not installed, a frame rate that is not above 0, the file cannot be written, or got no
            frame.
    """

    def __init__(self, path: str | os.PathLike[str], fps: float = 30.0, *, quality: int = 20):
        try:
            import av
        except ImportError as error:
            raise DenseVSError(
                "writing video needs PyAV, which is not installed; pip install 'dense-vs[viz]'"
            ) from error
        if not isinstance(fps, (int, float, np.number)) or not np.isfinite(fps) or fps <= 0:
            raise DenseVSError(f"fps is {fps!r}; expected a finite number above 0")
        self.path = Path(path)
        self._partial = self.path.with_name(f".{self.path.name}.partial")
        from fractions import Fraction

        with self._write_errors():
            self._partial.touch()  # PyAV would find out at the first frame
            self._container = av.open(str(self._partial), mode="w", format="mp4")
        self._stream: Any = None
        self._rate = Fraction(float(fps)).limit_denominator(1000)
        self._quality = quality
        self._frame_class = av.VideoFrame

    def write(self, image: np.ndarray) -> None:
        """Add an RGB uint8 ``(H, W, 3)`` frame; all of one size, odd sides are cut by a pixel.

        Raises:
            DenseVSError: another shape or dtype.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise DenseVSError(
                f"frame has shape {image.shape} and dtype {image.dtype}; expected uint8 of shape (H, W, 3)"
            )
        height, width = (side - side % 2 for side in image.shape[:2])  # H.264 in 4:2:0 takes even sides
        if self._stream is None:
            self._stream = self._container.add_stream("libx264", rate=self._rate)
            self._stream.width, self._stream.height = width, height
            self._stream.pix_fmt = "yuv420p"
            self._stream.options = {"crf": str(self._quality), "preset": "veryfast"}
        if (self._stream.height, self._stream.width) != (height, width):
            raise DenseVSError(
                f"frame of {width} x {height} pixels in a video of {self._stream.width} x {self._stream.height}"
            )
        frame = self._frame_class.from_ndarray(np.ascontiguousarray(image[:height, :width]), format="rgb24")
        with self._write_errors():
            for packet in self._stream.encode(frame):
                self._container.mux(packet)

    def __enter__(self) -> "VideoWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None and self._stream is None:
                raise DenseVSError(f"video {self.path} got no frame; expected at least one")
            if kind is None:
                with self._write_errors():
                    for packet in self._stream.encode():
                        self._container.mux(packet)
                    self._container.close()
                    self._partial.replace(self.path)
        finally:
            with suppress(OSError):  # closing an unfinished file may fail; it goes anyway
                self._container.close()
            self._partial.unlink(missing_ok=True)

    @contextmanager
    def _write_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DenseVSError(f"cannot write {self.path}: {error.strerror or error}") from error
