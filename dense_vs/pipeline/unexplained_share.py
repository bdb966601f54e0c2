"""The share of a body's image motion that a model of the body leaves unexplained (beyond the papers).

Lengths are summed, not squares: where the flow fails it fails grossly. Where a chain says that something moves and
something else is seen, it may be covered: that explains nothing, but is not worse than that.
"""

from functools import cached_property

import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.body.unexplained_motion import unexplained_motion
from dense_vs.kernels.launch import PixelLaunch

MOVING = 0.5  # px by the model: pixels that move less say nothing
LEAST_PIXELS = 50


class UnexplainedShare:
    """Asked for one motion after the other, in images of one size.

    Args:
        size: (height, width) [px].
        of_chain: whether the model is a chain, which the motion is taken to be the one of; else it is what is seen.
    """

    def __init__(self, size: tuple[int, int], of_chain: bool):
        self._size, self._of_chain = size, of_chain

    def __call__(self, body: np.ndarray, flow: np.ndarray, by_model: np.ndarray) -> float | None:
        """The share; None where too few pixels move.

        Args:
            body: bool ``(H, W)``, where the model has the body.
            flow: ``(H, W, 2)`` measured [px]; what is not finite does not count.
            by_model: ``(H, W, 2)``, what the joints cause by the model [px].
        """
        launch, given, (off, moved, count) = self._sums
        for array, image in zip(given, (body, flow, by_model), strict=True):
            array[...] = image
        for sums in (off, moved, count):
            sums.fill(0)
        launch()
        if int(count.sum()) < LEAST_PIXELS:
            return None
        return float(off.sum() / moved.sum())

    @cached_property
    def _sums(self) -> tuple[PixelLaunch, tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """The launch, what it is given, and its sums by row."""
        height, width = self._size
        given = tuple(wp.zeros((1, height, width), dtype=dtype, device="cpu") for dtype in (wp.uint8, wp.vec2, wp.vec2))
        sums = tuple(wp.zeros((1, height), dtype=dtype, device="cpu") for dtype in (wp.float64, wp.float64, wp.int32))
        arguments = [*given, MOVING, int(self._of_chain), *sums]
        launch = PixelLaunch(unexplained_motion, (1, height, width), arguments, "cpu", resolve_threads())
        return launch, tuple(array.numpy()[0] for array in given), tuple(array.numpy()[0] for array in sums)
