"""The images of a recording that bring new motion, at the times of the camera's own clock.

A camera of 15 images a second in a file of 30 gives a new image at every second stamp, but now and then after one or
three, where the recorder's phase slips: its stamps are late by up to an image. The camera itself is regular, so where
images repeat, the stamps are replaced by those of a clock that is even over a dozen images, at most one image of the
file away. Beyond the papers.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from dense_vs.recording.repeated_images import RepetitionFilter

GAP = 2.5  # times the usual step between images
HALF = 6  # images after, and one more before, that the clock is even over
REPEATING = 0.1  # share of repeated images from which stamps are those of the recorder and not of the camera


@dataclass(frozen=True)
class DistinctImage:
    """An image that brings new motion.

    Attributes:
        image: RGB uint8 ``(H, W, 3)``.
        gray: uint8 ``(H, W)``.
        time: on the camera's own clock [s].
        after_gap: whether images are missing before it, so that nothing can be learned from its step.
        evened: whether ``time`` is that of the even clock, as the stamps are the recorder's and not the camera's.
    """

    image: np.ndarray
    gray: np.ndarray
    time: float
    after_gap: bool
    evened: bool = False


class DistinctImages:
    """Iterates over images, without repetitions; a few images are held, however long the recording.

    Args:
        images: RGB uint8 ``(H, W, 3)`` and stamps [s].
        fps: nominal rate of the stamps [Hz].

    Attributes:
        images: how many were read so far.
        gaps: times after which images are missing, so far [s].
    """

    def __init__(self, images: Iterable[tuple[np.ndarray, float]], fps: float):
        self._source, self._step = images, 1 / fps
        self._repetition = RepetitionFilter()
        self.images = 0
        self.gaps: list[float] = []

    @property
    def repeated(self) -> int:
        """Images so far that repeat the one before."""
        return self._repetition.repeated

    def __iter__(self) -> Iterator[DistinctImage]:
        """Images in their order, half a dozen after they were read."""
        waiting: deque[DistinctImage] = deque()
        stamps: list[float] = []  # of images before and after, since the last gap
        last, after_gap, newest = None, False, -np.inf
        for image, time in self._source:
            self.images += 1
            if last is not None and time - last > GAP * self._step:
                for found in self._emptied(waiting, stamps, newest):
                    newest = found.time
                    yield found
                stamps.clear()
                self._repetition.restart()
                self.gaps.append(last)
                after_gap = True
            last = time
            gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
            if not self._repetition.keep(gray):
                continue
            waiting.append(DistinctImage(image, gray, time, after_gap))
            stamps.append(time)
            after_gap = False
            if len(waiting) > HALF:
                found = self._timed(waiting, stamps, newest)
                newest = found.time
                yield found
        yield from self._emptied(waiting, stamps, newest)

    def _emptied(self, waiting: deque[DistinctImage], stamps: list[float], newest: float) -> Iterator[DistinctImage]:
        while waiting:
            found = self._timed(waiting, stamps, newest)
            newest = found.time
            yield found

    def _timed(self, waiting: deque[DistinctImage], stamps: list[float], newest: float) -> DistinctImage:
        """The longest waiting image at its time; stamps that no image needs any more are dropped."""
        place = len(stamps) - len(waiting)
        found = waiting.popleft()
        if self.repeated > REPEATING * self.images:
            time = even_time(np.array(stamps), place, self._step)
            found = replace(found, time=max(time, newest + 0.1 * self._step), evened=True)
        del stamps[: max(place - HALF, 0)]
        return found


def even_time(stamps: np.ndarray, place: int, most: float) -> float:
    """Time of one of some images on a clock that is even over all of them, at most ``most`` from its stamp [s].

    Args:
        stamps: of neighboring images [s].
        place: index of the image.
        most: bound on the change, one image of the file [s].
    """
    if len(stamps) < 4:
        return float(stamps[place])
    steps = np.diff(stamps)
    # A step of nearly two usual ones holds an image that was lost; one and a half is a slip.
    counts = np.maximum(np.floor(steps / steps.mean() + 0.25), 1)
    number = np.concatenate([[0.0], np.cumsum(counts)])
    slope, start = np.polyfit(number, stamps - stamps[place], 1)
    shift = start + slope * number[place]
    return float(stamps[place] + np.clip(shift, -most, most))
