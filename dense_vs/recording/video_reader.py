"""Video files in: any codec of FFmpeg's (H.264, HEVC, VP9, AV1), upright, with their time stamps."""

import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.files import file_path
from dense_vs.recording.frame import MAX_PIXELS, check_size

FARTHEST = 1e9  # s, of a part's begin and end: what containers count in is bounded


class VideoReader:
    """The images of a video file, an :class:`~dense_vs.recording.ImageStream`.

    Args:
        path: video file.
        begin, end: part of the file to read, the images with ``begin <= time < end`` [s]; times count from ``begin``
            where it is given. All of it unless given.

    Attributes:
        height, width: image size as shown, after the rotation that the file asks for [px].
        fps: nominal frame rate [Hz].
        frame_count: number of frames that the container states, 0 where it does not or only a part is read.
        start: time of the first frame [s].
        codec: name of the codec.

    Raises:
        DenseVSError: PyAV is not installed; missing, not a video, or without a single frame; a begin or end that is no
            time.
    """

    def __init__(self, path: str | os.PathLike[str], *, begin: float | None = None, end: float | None = None):
        self.path = file_path(path)
        begin, end = (
            None if time is None else check_number(name, time, least=-FARTHEST, most=FARTHEST)
            for name, time in (("begin", begin), ("end", end))
        )
        if not self.path.is_file():
            raise DenseVSError(f"video {self.path} does not exist")
        self._av = _pyav()
        try:
            self._container = self._av.open(str(self.path), options={"probesize": "20000000"})
        except (self._av.FFmpegError, OSError, ValueError) as error:
            raise DenseVSError(
                f"video {self.path} cannot be opened: {_reason(error)}; expected a video file"
            ) from error
        if not self._container.streams.video:
            raise DenseVSError(f"video {self.path} cannot be opened: it holds no video stream; expected a video file")
        stream: Any = self._container.streams.video[0]
        self._stream = stream
        if stream.codec_context is None:
            raise DenseVSError(f"video {self.path} cannot be opened: its codec is not known to FFmpeg")
        check_size(max(stream.width, 1), max(stream.height, 1), f"video {self.path}")
        stream.codec_context.options = {"max_pixels": str(MAX_PIXELS)}
        self.codec = str(stream.codec_context.name)
        self.fps = float(stream.average_rate or stream.guessed_rate or 30.0)
        part = begin is not None or end is not None
        self.frame_count = 0 if part else int(stream.frames or 0)
        self._begin, self._end = begin, np.inf if end is None else end
        if begin:
            self._seek(begin)
        self._time: float | None = None
        self._images = self._decode()
        self._first = next(self._images, None)
        if self._first is None:
            raise DenseVSError(f"video {self.path} has no frame that can be read; is it truncated?")
        self.height, self.width = self._first[0].shape[:2]
        self.start = self._first[1]

    def __iter__(self) -> Iterator[tuple[np.ndarray, float]]:
        """RGB uint8 ``(H, W, 3)`` and time [s] of every frame, once; the first is at the container's first stamp.

        Raises:
            DenseVSError: the frame size changes, or the file is damaged.
        """
        if self._first is not None:
            first, self._first = self._first, None
            yield first
            yield from self._images
            self._container.close()

    def _seek(self, begin: float) -> None:
        """To the key frame before ``begin``; a file that cannot seek is read from its start."""
        try:
            self._container.seek(round(max(begin - 0.001, 0.0) / float(self._stream.time_base)), stream=self._stream)
        except self._av.FFmpegError:
            self._container.seek(0)

    def _decode(self) -> Iterator[tuple[np.ndarray, float]]:
        half = 0.5 / self.fps
        size = None
        try:
            for frame in self._container.decode(self._stream):
                stamp = frame.time
                if stamp is None or (self._time is not None and stamp <= self._time):  # no stamps: count frames
                    stamp = 0.0 if self._time is None else self._time + 1 / self.fps
                self._time = stamp
                if self._begin is not None:
                    # Parts of a joined file begin at multiples of a frame time that are rounded in its table.
                    if stamp < self._begin - half:
                        continue
                    if stamp >= self._end - half:
                        return
                    stamp -= self._begin
                image = self._upright(frame)
                size = size or image.shape
                if image.shape != size:
                    raise DenseVSError(
                        f"video {self.path} changes its frame size from {size[1]} x {size[0]} to "
                        f"{image.shape[1]} x {image.shape[0]} at {stamp:.3f} s"
                    )
                yield image, stamp
        except (self._av.FFmpegError, MemoryError) as error:
            where = "at its beginning" if self._time is None else f"after {self._time:.3f} s"
            raise DenseVSError(f"video {self.path} has no frame that can be read {where}: {_reason(error)}") from error

    def _upright(self, frame: Any) -> np.ndarray:
        image = frame.to_ndarray(format="rgb24")
        quarters = round((getattr(frame, "rotation", 0) or 0) / 90) % 4
        return np.ascontiguousarray(np.rot90(image, quarters)) if quarters else image


def _pyav() -> Any:
    try:
        import av
    except ImportError as error:
        raise DenseVSError(
            "reading video needs PyAV, which is not installed; pip install 'dense-vs[recordings]'"
        ) from error
    return av


def _reason(error: BaseException) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
