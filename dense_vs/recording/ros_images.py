"""Image messages of ROS as RGB: raw in the usual encodings, JPEG and PNG, and H.264 or HEVC a packet a message."""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.recording.frame import MAX_PIXELS, check_size
from dense_vs.recording.stored_image import read_image

# bytes a pixel, conversion to RGB
RAW: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8uc3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "8uc4": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "8uc1": (1, cv2.COLOR_GRAY2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUY2),
    # ROS names the pattern by its first row, OpenCV by its second.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2RGB),
}
VIDEO = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "vp9": "vp9", "av1": "av1"}


class ImageDecoder:
    """Decodes the messages of one topic in their order.

    Args:
        what: the topic is called, for errors.
    """

    def __init__(self, what: str):
        self._what = what
        self._codec: Any = None
        self._times: dict[int, float] = {}
        self._packets = 0

    def decode(self, message: Any, time: float) -> Iterator[tuple[np.ndarray, float]]:
        """RGB uint8 ``(H, W, 3)`` and time [s] of the images that a message completes.

        Raises:
            DenseVSError: an encoding that is not known, or damaged data.
        """
        if hasattr(message, "step"):
            yield self._raw(message), time
            return
        form = (message.format if hasattr(message, "format") else message.encoding).lower()
        codec = next((VIDEO[name] for name in VIDEO if name in form), None)
        data = bytes(message.data)
        check_size(max(getattr(message, "width", 1), 1), max(getattr(message, "height", 1), 1), self._what)
        if codec is None:
            yield read_image(data, f"image at {time:.3f} s of {self._what}"), time
        else:
            yield from self._video(codec, data, time)

    def flush(self) -> Iterator[tuple[np.ndarray, float]]:
        """Images that a video codec still holds at the end."""
        if self._codec is not None:
            yield from self._packet(None)

    def _raw(self, message: Any) -> np.ndarray:
        encoding = message.encoding.lower()
        if encoding not in RAW:
            raise DenseVSError(f"{self._what} has encoding {message.encoding!r}; expected one of {', '.join(RAW)}")
        depth, conversion = RAW[encoding]
        height, width, step = int(message.height), int(message.width), int(message.step)
        check_size(width, height, self._what)
        step = step or width * depth
        data = np.frombuffer(message.data, np.uint8)
        if step < width * depth or data.size < step * (height - 1) + width * depth:
            raise DenseVSError(
                f"{self._what} has an image of {data.size} bytes; expected {width} x {height} pixels of {depth} bytes"
            )
        data = np.pad(data, (0, max(step * height - data.size, 0)))[: step * height]
        pixels = data.reshape(height, step)[:, : width * depth].reshape(height, width, depth)
        if conversion is None:
            return pixels.copy()
        return cv2.cvtColor(np.ascontiguousarray(pixels[..., 0] if depth == 1 else pixels), conversion)

    def _video(self, codec: str, data: bytes, time: float) -> Iterator[tuple[np.ndarray, float]]:
        import av

        if self._codec is None:
            self._codec = av.CodecContext.create(codec, "r")
            self._codec.options = {"max_pixels": str(MAX_PIXELS)}
        packet = av.Packet(data)
        packet.pts = packet.dts = self._packets
        self._times[self._packets] = time
        self._packets += 1
        yield from self._packet(packet)

    def _packet(self, packet: Any) -> Iterator[tuple[np.ndarray, float]]:
        from av.error import FFmpegError

        try:
            frames = self._codec.decode(packet)
        except FFmpegError as error:
            raise DenseVSError(f"{self._what} has damaged video: {error.strerror or error}") from error
        for frame in frames:
            if frame.pts in self._times:
                check_size(frame.width, frame.height, self._what)
                yield frame.to_ndarray(format="rgb24"), self._times.pop(frame.pts)
        while len(self._times) > 64:  # packets that never became an image
            self._times.pop(next(iter(self._times)))
