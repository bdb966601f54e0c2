"""A camera at the pace of its stamps: for a simulator or a recording, which would else run as fast as it can."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from dense_vs.robot.protocols import Camera

BEHIND = 0.2  # s; a camera that is later than this does not try to catch up


class PacedCamera:
    """Gives each image not before its time, counted from the first.

    Args:
        camera: whose images come without waiting.
        clock, sleep: of the computer [s].
    """

    def __init__(
        self,
        camera: Camera,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Any] = time.sleep,
    ):
        self._camera, self._clock, self._sleep = camera, clock, sleep
        self._start: float | None = None

    def read(self) -> tuple[np.ndarray, float]:
        """The next image and its stamp [s]."""
        image, stamp = self._camera.read()
        now = self._clock()
        if self._start is None or now - stamp - self._start > BEHIND:
            self._start = now - stamp
        if (early := self._start + stamp - now) > 0:
            self._sleep(early)
        return image, stamp
