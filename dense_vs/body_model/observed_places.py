"""Places in which points of a body were seen, laid out point by point, and kernels launched on parts of the points."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.kernels.body.observed_points import ObservedPoints
from dense_vs.kernels.cpu_threads import share_out
from dense_vs.kernels.recorded import recorded_parts

PARTS = 8  # of the points, with about as many places each: always as many, so that sums do not depend on the threads


class ObservedPlaces:
    """O places of M points in some images.

    Args:
        point: ``(O,)`` that each is of, in increasing order.
        image: ``(O,)`` that each was seen in.
        links: ``(M,)`` that the points are on, from 0.
        places: ``(O, 2)`` [px].
        directions: ``(O, 2, 2)``, what errors are multiplied by; 1 if None.
    """

    def __init__(
        self,
        point: np.ndarray,
        image: np.ndarray,
        links: np.ndarray,
        places: np.ndarray,
        directions: np.ndarray | None,
    ):
        self.point_count, self.place_count = len(links), len(point)
        if directions is None:
            directions = np.broadcast_to(np.eye(2), (len(point), 2, 2))
        starts = np.searchsorted(point, np.arange(len(links) + 1))
        share = np.arange(1, PARTS) * len(point) // PARTS
        self.edges = np.concatenate([[0], np.searchsorted(starts[1:], share), [len(links)]])
        self._filled = [part for part, (first, last) in enumerate(pairwise(self.edges)) if last > first]
        self._fixed = {
            "starts": on_cpu(starts, wp.int32),
            "link_of": on_cpu(links, wp.int32),
            "images": on_cpu(image, wp.int32),
            "places": on_cpu(places, wp.vec2d),
            "directions": on_cpu(directions, wp.mat22d),
        }

    def launch(self, kernel: Any, poses: tuple[np.ndarray, np.ndarray], arguments: Sequence[Any]) -> None:
        """Run a kernel, a thread a part of the points.

        Args:
            kernel: takes the part, the parts' edges and :class:`ObservedPoints` first.
            poses: rotations ``(T, L, 3, 3)`` and translations ``(T, L, 3)`` of the links in the images.
            arguments: what follows, inputs before outputs.
        """
        observed: Any = ObservedPoints()
        for name, values in self._fixed.items():
            setattr(observed, name, values)
        observed.rotation, observed.translation = on_cpu(poses[0], wp.mat33d), on_cpu(poses[1], wp.vec3d)
        if self._filled:
            parts = [(part, (1,)) for part in self._filled]
            commands = recorded_parts(kernel, parts, [on_cpu(self.edges, wp.int32), observed, *arguments], "cpu")
            share_out([command.launch for command in commands], min(resolve_threads(), len(parts)))


def on_cpu(values: np.ndarray, dtype: Any = wp.float64) -> Any:
    """A Warp array on the CPU, the same memory where it is laid out so."""
    kind = np.int32 if dtype is wp.int32 else np.float64
    return wp.array(np.ascontiguousarray(values, dtype=kind), dtype=dtype, device="cpu", copy=False)
