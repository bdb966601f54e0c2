"""Video files out: H.264 in MP4."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import file_path
from dense_vs.recording.writer_checks import check_open
from dense_vs.robot.camera_image import check_rgb

SLOWEST, FASTEST = 1e-3, 1e5  # Hz; frame rates are fractions of 32-bit numbers
MOST_QUALITY = 51  # constant rate factor


class VideoWriter:
    """Writes RGB frames as H.264 in an MP4 file, which browsers play; use as a context manager.

    The file takes its name when it is complete; an error leaves none.

    Args:
        path: of the file.
        fps: frame rate, 0.001 to 100,000 [Hz].
        quality: constant rate factor, 0 to 51, lower is better; 12 keeps texture for optical flow, 20 is for viewing.

    Raises:
        DenseVSError: PyAV is not installed, a frame rate or quality out of range, the file cannot be written, got no
            frame, or gets one when it is complete.
    """

    def __init__(self, path: str | os.PathLike[str], fps: float = 30.0, *, quality: int = 20):
        try:
            import av
        except ImportError as error:
            raise DenseVSError(
                "writing video needs PyAV, which is not installed; pip install 'dense-vs[viz]'"
            ) from error
        fps = check_number("fps", fps, least=SLOWEST, most=FASTEST)
        self._quality = check_whole("quality", quality, least=0, most=MOST_QUALITY)
        self.path = file_path(path)
        if not self.path.name or self.path.is_dir():
            raise DenseVSError(f"cannot write {self.path}: it is a folder; expected a file's name")
        self._partial = self.path.with_name(f".{self.path.name}.partial")
        from fractions import Fraction

        with self._write_errors():
            self._partial.touch()  # PyAV would find out at the first frame
            self._container = av.open(str(self._partial), mode="w", format="mp4")
        self._closed = False
        self._stream: Any = None
        self._size: tuple[int, int] | None = None
        self._rate = Fraction(fps).limit_denominator(1000)
        self._frame_class = av.VideoFrame

    def write(self, image: np.ndarray) -> None:
        """Add an RGB uint8 ``(H, W, 3)`` frame; all of one size, odd sides are cut by a pixel.

        Raises:
            DenseVSError: another shape or dtype, or a video that is complete.
        """
        check_open(self._closed, self.path)
        image = check_rgb(image, "frame", least=2)
        self._size = self._size or image.shape[:2]
        if image.shape[:2] != self._size:
            raise DenseVSError(
                f"frame of {image.shape[1]} x {image.shape[0]} pixels in a video of {self._size[1]} x {self._size[0]}"
            )
        height, width = (side - side % 2 for side in image.shape[:2])  # H.264 in 4:2:0 takes even sides
        if self._stream is None:
            self._stream = self._container.add_stream("libx264", rate=self._rate)
            self._stream.width, self._stream.height = width, height
            self._stream.pix_fmt = "yuv420p"
            self._stream.options = {"crf": str(self._quality), "preset": "veryfast"}
        frame = self._frame_class.from_ndarray(np.ascontiguousarray(image[:height, :width]), format="rgb24")
        with self._write_errors():
            for packet in self._stream.encode(frame):
                self._container.mux(packet)

    def __enter__(self) -> "VideoWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._closed:
            return
        self._closed = True
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
