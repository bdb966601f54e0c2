"""What covers a known body, told by motion: J is not unlearned behind it, nor learned from it (beyond DIJE).

Where a model has the body, flow u and the motion p that the joints cause should agree. The share of the two that they
do not have in common, |u - p|^2 / (|u|^2 + |p|^2), summed over a small window and the last few motions, is near 0 on
the body, 1 where something stands still before the moving body or moves by itself before it, see :class:`MotionCheck`,
which asks the same of the whole image. Where J as it is now explains the flow better than the model does, it counts
instead: a model that is wrong in some place covers nothing, and a tool in the hand, whose J is learned, does not. What
covers some of the body covers also what is beside it, as far as it is strange in the same way.
"""

from functools import cached_property
from typing import Any

import cv2
import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.body.unshared_motion import unshared_motion
from dense_vs.kernels.launch import PixelLaunch

WINDOW = 11  # px, side of the window
DECAY = 0.3  # of the sums, from one measured motion to the next
STRANGE = 0.35  # share from which a pixel counts as covered
FAINT = 0.05  # px^2 a pixel: sums below say nothing
SAYS = 0.25  # of the squared motion, from which J as it is now says anything of it
LEAST_PIXELS = 60  # of a connected part that are on the body: flow fails in smaller ones
LATELY = 12  # measured motions for which labels go by the model where something was in front
BESIDE = 6  # px around it that are covered too, as flow bleeds over outlines
MOST_COVERED = 0.75  # share of the body that moves, beyond which either flow has failed or the model is wrong
PATIENCE = 5  # measured motions of this kind in a row, after which it is the model, and nothing is covered
LONGEST = 200  # measured motions, after which what is seen counts again: not covered, the body has changed


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
        self._off = np.zeros(size, np.float32)
        self._moved = np.zeros(size, np.float32)
        self._since = np.zeros(size, np.int16)  # motions that each has been covered for
        self._ago = np.full(size, LATELY + 1, np.int16)
        self._doubted, self.doubtful = 0, False

    def observe(self, body: np.ndarray, flow: np.ndarray, by_model: np.ndarray, by_estimate: np.ndarray) -> np.ndarray:
        """Take a measured motion; :attr:`hidden` by then.

        Args:
            body: bool ``(H, W)``, where the model has the body.
            flow: ``(H, W, 2)`` measured [px].
            by_model, by_estimate: ``(H, W, 2)`` what joints cause by the model, 0 off the body, and by J as it is [px].
        """
        off, moved = self._unshared(flow, by_model, by_estimate)
        window = (WINDOW, WINDOW)
        self._off *= DECAY
        self._off += cv2.blur(off, window)
        self._moved *= DECAY
        self._moved += cv2.blur(moved, window)
        told = self._moved > FAINT
        strange = told & (self._off > STRANGE * self._moved)
        np.putmask(self._since, told & ~strange, 0)
        self.doubtful = bool(np.count_nonzero(strange & body) > MOST_COVERED * np.count_nonzero(told & body))
        self._doubted = self._doubted + 1 if self.doubtful else 0
        if self._doubted > PATIENCE:
            strange[...] = False
        strange |= ~told & self.cover  # nothing moves: nothing has come or gone
        self.cover = _parts_on(strange & (self._since <= LONGEST), body)
        self.hidden = self.cover & body
        self.around = self._about()
        self._since += self.cover
        self._ago += self._ago <= LATELY
        np.putmask(self._ago, self.around, 0)
        self.lately = self._ago <= LATELY
        return self.hidden

    def _unshared(
        self, flow: np.ndarray, by_model: np.ndarray, by_estimate: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Squared motion ``(H, W)`` that is not shared, and all of it [px^2]; 0 where the flow is not finite.

        A J of nearly 0 explains anything that stands still: it has to explain what is seen to move.
        """
        launch, given, off, moved = self._motions
        for array, image in zip(given, (flow, by_model, by_estimate), strict=True):
            array.numpy()[0] = image
        launch()
        return off.numpy()[0], moved.numpy()[0]

    @cached_property
    def _motions(self) -> tuple[PixelLaunch, tuple[wp.array, ...], wp.array, wp.array]:
        """The launch of :meth:`_unshared`, the motions that it is given, and its results."""
        height, width = self._off.shape
        shape, vec2 = (1, height, width), wp.vec2
        given = tuple(wp.zeros(shape, dtype=vec2, device="cpu") for _ in range(3))
        off, moved = (wp.zeros(shape, dtype=wp.float32, device="cpu") for _ in range(2))
        launch = PixelLaunch(unshared_motion, shape, [*given, SAYS, off, moved], "cpu", resolve_threads())
        return launch, given, off, moved

    def _about(self) -> np.ndarray:
        """What covers the body and what is beside it."""
        side = 2 * BESIDE + 1
        return cv2.dilate(self.cover.astype(np.uint8), np.ones((side, side), np.uint8)) > 0


def _parts_on(mask: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Connected parts of a mask ``(H, W)`` with at least :data:`LEAST_PIXELS` on the body."""
    if np.count_nonzero(mask & body) < LEAST_PIXELS:
        return np.zeros_like(mask)
    parts: Any
    count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    kept = np.bincount(parts[body], minlength=count) >= LEAST_PIXELS
    kept[0] = False
    return kept[parts]
