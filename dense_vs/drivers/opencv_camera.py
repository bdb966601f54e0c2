"""Any camera that OpenCV opens (V4L2, UVC, a stream's address), read by a thread so that the newest image is at hand.

A driver's buffer holds some images; a loop slower than the camera would see them seconds late. So the thread takes
every image as it comes, stamps it then on the computer's monotonic clock, and keeps the last one only. A camera that
stalls is opened anew; one that changes its image's size is refused, as the filter is made for one size.
"""

import threading
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError

RETRY_SECONDS = 1.0


class OpenCVCamera:
    """A camera behind the ``Camera`` protocol. Stamps are ``time.monotonic()``, as of the other drivers here.

    Not run on hardware here: tested with a stand-in that has ``cv2.VideoCapture``'s interface.

    Args:
        source: index, device path or address of a stream.
        width, height: asked of the camera [px]; what it gives counts.
        fps: asked of the camera [Hz].
        delay: from the moment the image was taken to its arrival, taken off the stamp [s]; some 30 to 60 ms for USB.
        timeout: time without an image after which :meth:`read` raises, and the camera is opened anew [s].
        open_capture: makes the capture; ``cv2.VideoCapture`` unless given.
        clock: of the stamps [s].

    Raises:
        DenseVSError: the camera cannot be opened, an option out of range.
    """

    def __init__(
        self,
        source: int | str = 0,
        *,
        width: int | None = None,
        height: int | None = None,
        fps: float | None = None,
        delay: float = 0.0,
        timeout: float = 1.0,
        open_capture: Callable[..., Any] = cv2.VideoCapture,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._source, self._open, self._clock = source, open_capture, clock
        self._wanted = {cv2.CAP_PROP_FRAME_WIDTH: width, cv2.CAP_PROP_FRAME_HEIGHT: height, cv2.CAP_PROP_FPS: fps}
        self._delay = check_number("delay", delay, least=0)
        self._timeout = check_number("timeout", timeout, above=0)
        self._news = threading.Condition()
        self._image: np.ndarray | None = None
        self._time = self._given = -np.inf
        self._size: tuple[int, ...] | None = None
        self._closed = threading.Event()
        self._capture = self._opened()
        self._thread = threading.Thread(target=self._take, name="camera", daemon=True)
        self._thread.start()

    def read(self) -> tuple[np.ndarray, float]:
        """The newest image that was not given yet, RGB uint8 ``(H, W, 3)``, and when it was taken [s].

        Raises:
            DenseVSError: none came in time, or its size is another than before; the next call tries again.
        """
        with self._news:
            if not self._news.wait_for(lambda: self._time > self._given, self._timeout):
                raise DenseVSError(f"camera {self._source} gave no image for {self._timeout:g} s; it is opened anew")
            assert self._image is not None
            image, self._given = self._image, self._time
        size = image.shape[:2]
        if self._size is None:
            self._size = size
        if size != self._size:
            raise DenseVSError(
                f"camera {self._source} gives {size[1]} x {size[0]} px now; expected {self._size[1]} x {self._size[0]}"
            )
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB), self._given - self._delay

    def close(self) -> None:
        """Give the camera back."""
        self._closed.set()
        self._thread.join(timeout=2 * self._timeout)
        self._capture.release()

    def _opened(self) -> Any:
        capture = self._open(self._source)
        if not capture.isOpened():
            capture.release()
            raise DenseVSError(f"cannot open camera {self._source}; expected an index, a device or an address")
        for name, value in self._wanted.items():
            if value is not None:
                capture.set(name, value)
        return capture

    def _take(self) -> None:
        came = self._clock()
        while not self._closed.is_set():
            there, image = self._capture.read()
            now = self._clock()
            if there and image is not None:
                came = now
                with self._news:
                    self._image, self._time = image, max(now, float(np.nextafter(self._time, np.inf)))
                    self._news.notify_all()
            elif now - came > self._timeout:
                self._reopen()
                came = self._clock()
            else:
                self._closed.wait(0.005)

    def _reopen(self) -> None:
        self._capture.release()
        while not self._closed.wait(min(RETRY_SECONDS, self._timeout)):
            try:
                self._capture = self._opened()
                return
            except DenseVSError:  # unplugged: it may come back
                continue
