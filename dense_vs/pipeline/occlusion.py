"""What covers a known body, told by motion: J is not unlearned behind it, nor learned from it (beyond DIJE).

Where a model has the body, flow u and the motion p that the joints cause should agree. The share of the two that they
do not have in common, |u - p|^2 / (|u|^2 + |p|^2), summed over a small window and the last few motions, is near 0 on
the body, 1 where something stands still before the moving body or moves by itself before it, see :class:`MotionCheck`,
which asks the same of the whole image. Where J as it is now explains the flow better than the model does, it counts
instead: a model that is wrong in some place covers nothing, and a tool in the hand, whose J is learned, does not. What
covers some of the body covers also what is beside it, as far as it is strange in the same way. Flow is smooth over more
than a window, so every second pixel of every second row is looked at, and speaks for the three beside it.
"""

from functools import cached_property
from typing import Any

import cv2
import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.body.covered import covered
from dense_vs.kernels.body.unshared_motion import unshared_motion
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.views import seen_as

GRID = 2  # px between the pixels that are looked at
WINDOW = 5  # of them, side of the window
DECAY = 0.3  # of the sums, from one measured motion to the next
STRANGE = 0.35  # share from which a pixel counts as covered
FAINT = 0.05  # px^2 a pixel: sums below say nothing
SAYS = 0.25  # of the squared motion, from which J as it is now says anything of it
LEAST_PIXELS = 15  # looked at, of a connected part, that are on the body: flow fails in smaller ones
LATELY = 12  # measured motions for which labels go by the model where something was in front
BESIDE = 6  # px around it that are covered too, as flow bleeds over outlines
MOST_COVERED = 0.75  # share of the body that moves, beyond which either flow has failed or the model is wrong
PATIENCE = 5  # measured motions of this kind in a row, after which it is the model, and nothing is covered
LONGEST = 200  # measured motions, after which what is seen counts again: not covered, the body has changed
_LOOKED_AT = np.s_[::GRID, ::GRID]


class Occlusion:
    """What covers the body in the images of one camera.

    Attributes:
        cover: bool ``(H, W)``, what is in front of the body and beside it, by the last motion.
        hidden: bool ``(H, W)``, pixels of the body behind it.
        around: bool ``(H, W)``, what covers and pixels next to it, whose flow says nothing of the body.
        lately: bool ``(H, W)``, pixels that were covered within the last :data:`LATELY` motions.
        doubtful: whether nearly all of the body seemed covered by the last motion: rather, this was not the joints'.
    """

    def __init__(self, size: tuple[int, int]):
        self.cover, self.hidden, self.around, self.lately = (np.zeros(size, bool) for _ in range(4))
        self._since = np.zeros((1, *self.cover[_LOOKED_AT].shape), np.int16)  # motions that each has been covered for
        self._ago = np.full(size, LATELY + 1, np.int16)
        self._doubted, self.doubtful = 0, False

    def observe(self, body: np.ndarray, flow: np.ndarray, by_model: np.ndarray, by_estimate: np.ndarray) -> np.ndarray:
        """Take a measured motion; :attr:`hidden` by then.

        Args:
            body: bool ``(H, W)``, where the model has the body.
            flow: ``(H, W, 2)`` measured [px].
            by_model, by_estimate: ``(H, W, 2)`` what joints cause by the model, 0 off the body, and by J as it is [px].
        """
        on_body, *motions = (image[_LOOKED_AT] for image in (body, flow, by_model, by_estimate))
        cover = _parts_on(self._strange(on_body, *motions), on_body)
        self._since[0] += cover
        self.cover = cover.repeat(GRID, axis=0).repeat(GRID, axis=1)[: body.shape[0], : body.shape[1]]
        self.hidden = self.cover & body
        self.around = self._about()
        self._ago += self._ago <= LATELY
        np.putmask(self._ago, self.around, 0)
        self.lately = self._ago <= LATELY
        return self.hidden

    def _strange(self, body: np.ndarray, flow: np.ndarray, by_model: np.ndarray, by_estimate: np.ndarray) -> np.ndarray:
        """Pixels that are looked at and covered, on the body or not, by the last motions."""
        (compare, judge), (*given, on_body, cover), motions, (found, counts) = self._launches
        images = flow, by_model, by_estimate, body, self.cover[_LOOKED_AT]
        for array, image in zip((*given, on_body, cover), images, strict=True):
            array[...] = image
        compare()
        for motion in motions:
            cv2.blur(motion, (WINDOW, WINDOW), dst=motion)
        judge()
        told, strange = counts.sum(axis=0)
        self.doubtful = bool(strange > MOST_COVERED * told)
        self._doubted = self._doubted + 1 if self.doubtful else 0
        return found == 2 if self._doubted > PATIENCE else found > 0

    @cached_property
    def _launches(self) -> tuple[Any, ...]:
        """What compares motions and what judges them, the motions, squares, masks that they are given, and results.

        A J of nearly 0 explains anything that stands still: it has to explain what is seen to move.
        """
        height, width = self.cover[_LOOKED_AT].shape
        shape = (1, height, width)

        def memory(count: int, dtype: Any) -> tuple[Any, ...]:
            return tuple(wp.zeros(shape, dtype=dtype, device="cpu") for _ in range(count))

        given, squares, sums = memory(3, wp.vec2), memory(2, wp.float32), memory(2, wp.float32)
        on_body, cover, found = memory(3, wp.uint8)
        counts = wp.zeros(shape[:2], dtype=wp.vec2i, device="cpu")
        limits = [DECAY, STRANGE, FAINT, LONGEST]
        judged = [*squares, on_body, cover, *limits, *sums, seen_as(self._since, wp.int16, shape), found, counts]
        compare, judge = (
            PixelLaunch(kernel, shape, arguments, "cpu", resolve_threads())
            for kernel, arguments in ((unshared_motion, [*given, SAYS, *squares]), (covered, judged))
        )
        groups = (*given, on_body, cover), squares, (found, counts)
        return (compare, judge), *(tuple(array.numpy()[0] for array in group) for group in groups)

    def _about(self) -> np.ndarray:
        """What covers the body and what is beside it."""
        if not self.cover.any():
            return np.zeros_like(self.cover)
        side = 2 * BESIDE + 1
        return cv2.dilate(self.cover.astype(np.uint8), np.ones((side, side), np.uint8)) > 0


def _parts_on(mask: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Connected parts of a mask ``(h, w)`` with at least :data:`LEAST_PIXELS` on the body."""
    if np.count_nonzero(mask & body) < LEAST_PIXELS:
        return np.zeros_like(mask)
    parts: Any
    count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    kept = np.bincount(parts[body], minlength=count) >= LEAST_PIXELS
    kept[0] = False
    return kept.take(parts)  # half the time of an index
