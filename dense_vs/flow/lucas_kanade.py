"""Dense flow by Lucas and Kanade's equations in Gaussian windows, from coarse to fine (Lucas and Kanade, 1981).

At every pixel the step d minimizes, over a window w around it,

    sum w (W - I - g . d)^2 + lambda |d|^2

with I the present image, W the previous one warped by the flow so far, and g the mean gradient of the two. Plain
surfaces have few gradients, so the first windows are wide: what little texture there is speaks for all of them. The
last step narrows the window and is held to the one before by a larger lambda, so that only where there is texture
neighbors may differ. Images are taken relative to their local mean, so that exposure and flicker cancel.

Beside dense inverse search J gets better from it on plain arms with seams and edges, where wide windows bridge what is
plain; where there is texture all over, search is sharper at outlines.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.flow.lucas_kanade import lucas_kanade_kernel, scratch_floats
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.views import seen_as

PRESMOOTHING = 0.8  # px, standard deviation
LOCAL_MEAN = 17  # px, side of the square that an image is taken relative to
COARSEST_SIDE = 60  # px, about: the shorter side of the coarsest level
MAX_STEP = 2.0  # px, of one solution
WIDE, WIDE_WEIGHT = 5.0, 0.1  # window [px, standard deviation] and lambda [gray levels^2 / px^2] of every level
NARROW, NARROW_WEIGHT = 2.5, 10.0  # of the last step
_FEW_PIXELS = 10_000  # of a level that one thread is done with sooner than it is shared out


class LucasKanade:
    """Flow between two images; what depends on their size alone is kept from one call to the next.

    An image that was the last call's present one is not prepared again.

    Args:
        threads: CPU threads, all allowed cores unless given.

    Raises:
        DenseVSError: not such a number.
    """

    def __init__(self, threads: int | None = None):
        self._threads = resolve_threads(threads)
        self._sizes: dict[tuple[int, int], _Levels] = {}

    def __call__(self, previous: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Flow (H, W, 2) float32 [px] of uint8 images (H, W), stored at the pixels of the present one."""
        height, width = present.shape
        if (height, width) not in self._sizes:
            self._sizes[height, width] = _Levels(height, width, self._threads)
        return self._sizes[height, width].flow(previous, present)


class _Levels:
    """Pyramids of two images that take turns, the flow of every level, and the launches bound to them."""

    def __init__(self, height: int, width: int, threads: int):
        count = max(0, round(np.log2(min(height, width) / COARSEST_SIDE)))
        shapes = [(height, width)]
        for _ in range(count):
            shapes.append(((shapes[-1][0] + 1) // 2, (shapes[-1][1] + 1) // 2))
        self._images = [np.empty((height, width), np.uint8) for _ in range(2)]
        self._smooth = np.empty((height, width), np.float32)
        self._known = False
        self._pyramids = [[np.empty(shape, np.float32) for shape in shapes] for _ in range(2)]
        # The finest level takes two steps, from one array to the other and back.
        self._flows = [[np.zeros((*shape, 2), np.float32) for _ in range(2)] for shape in shapes]
        self._now = 0
        self._steps = [self._recorded(now, threads) for now in range(2)]

    def flow(self, previous: np.ndarray, present: np.ndarray) -> np.ndarray:
        """As of :class:`LucasKanade`."""
        if not (self._known and np.array_equal(self._images[self._now], previous)):
            self._prepare(previous, self._now)
        self._now = 1 - self._now
        self._known = False  # until this call is through
        self._prepare(present, self._now)
        self._flows[-1][0].fill(0.0)
        for level in range(len(self._flows) - 1, -1, -1):
            start = self._flows[level][0]
            if level + 1 < len(self._flows):
                coarse = self._flows[level + 1][1]
                for axis in range(2):  # x and y
                    coarse[..., axis] *= np.float32(start.shape[1 - axis] / coarse.shape[1 - axis])
                cv2.resize(coarse, start.shape[1::-1], dst=start, interpolation=cv2.INTER_LINEAR)
            for launch in self._steps[self._now][level]:
                launch()
        self._known = True
        return self._flows[0][0].copy()

    def _prepare(self, image: np.ndarray, which: int) -> None:
        """An image's pyramid: smoothed, less its local mean."""
        np.copyto(self._images[which], image)
        levels, pyramid = image.astype(np.float32), self._pyramids[which]
        levels -= cv2.blur(levels, (LOCAL_MEAN, LOCAL_MEAN), dst=self._smooth)
        cv2.GaussianBlur(levels, (0, 0), PRESMOOTHING, dst=pyramid[0])
        for fine, coarse in pairwise(pyramid):
            cv2.pyrDown(fine, dst=coarse)

    def _recorded(self, now: int, threads: int) -> list[list[Callable[[], None]]]:
        """Launches of every level, the finest first, where pyramid ``now`` is the present image's."""
        steps: list[list[Callable[[], None]]] = []
        for level, flows in enumerate(self._flows):
            height, width = flows[0].shape[:2]
            bands = threads if height * width > _FEW_PIXELS else 1
            before, present = (
                seen_as(self._pyramids[which][level], wp.float32, (height, width)) for which in (1 - now, now)
            )
            shifts: list[Any] = [seen_as(flow, wp.vec2, (height, width)) for flow in flows]
            launches: list[Callable[[], None]] = []
            for sigma, weight in ((WIDE, WIDE_WEIGHT), (NARROW, NARROW_WEIGHT))[: 2 if level == 0 else 1]:
                shares = _window(sigma)
                radius = len(shares) // 2
                scratch = np.zeros((bands, scratch_floats(radius)), np.float32)
                window, room = (seen_as(array, wp.float32, array.shape) for array in (shares, scratch))
                arguments = [before, present, shifts[0], window, weight, MAX_STEP, room, shifts[1]]
                launches.append(PixelLaunch(lucas_kanade_kernel(radius), (1, bands, 1), arguments, "cpu", bands))
                shifts.reverse()
            steps.append(launches)
        return steps


def _window(sigma: float) -> np.ndarray:
    """Gaussian weights up to four standard deviations."""
    places = np.arange(-round(4 * sigma), round(4 * sigma) + 1)
    weights = np.exp(-0.5 * (places / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)
