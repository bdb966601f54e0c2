"""J at image points by a filter's state: recorded once for as many points, as packing takes longer than the kernel."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.recorded import recorded
from dense_vs.kernels.views import write

KINDS = 4  # numbers of points that are kept: one point, a grid of them, and few others are asked for again and again


class SampledPoints:
    """Answers for either half of a double-buffered state.

    Args:
        kernels: of the filter.
        state: the two halves.
        displacement: of the two halves, (B, N) float64 [rad].
    """

    def __init__(self, kernels: SimpleNamespace, state: Sequence[wp.array], displacement: Sequence[wp.array]):
        self._kernels, self._halves = kernels, list(zip(state, displacement, strict=True))
        self._kept: dict[tuple[int, ...], tuple[Any, Any, list[Any]]] = {}  # by shape: points, answer, launches

    def __call__(self, points: np.ndarray, now: int) -> wp.array:
        """J at points (B, K, 2) [px], (B, K) of (2, N); valid until asked again.

        Args:
            points: of every world.
            now: which half is the present one.
        """
        where, found, launches = self._of_shape(points.shape[:2])
        if points.size:
            write(where, np.ascontiguousarray(points, np.float32))
            launches[now].launch()
        return found

    def _of_shape(self, shape: tuple[int, ...]) -> tuple[Any, Any, list[Any]]:
        if shape not in self._kept:
            device = self._halves[0][1].device
            where, found = (wp.zeros(shape, dtype=kind, device=device) for kind in (wp.vec2, self._kernels.Jacobian))
            halves = self._halves if shape[1] else []
            launches = [recorded(self._kernels.sample_points, shape, [*half, where, found], device) for half in halves]
            kept = [*self._kept.items()][1 - KINDS :]
            self._kept = {**dict(kept), shape: (where, found, launches)}
        return self._kept[shape]
