"""What was seen of points of a body, laid out for the kernels that compare it with a chain."""

from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from dense_vs.device import resolve_threads
from dense_vs.generative.least_squares.pixel_problem import NormalEquations
from dense_vs.kernels.body.track_equations import LANES, MOST_COLUMNS, track_equations, track_errors
from dense_vs.kernels.launch import recorded_parts, share_out

PARTS = 8  # of the points, each summed for itself: always as many, so that sums do not depend on the threads


class TrackObservations:
    """O places of M points in some images.

    Args:
        point: ``(O,)`` that each is of, in increasing order.
        image: ``(O,)`` that each was seen in.
        links: ``(M,)`` that the points are on, from 0.
        target: ``(O, 2)`` the places [px].
        directions: ``(O, 2, 2)``, what errors are multiplied by; 1 if None.
    """

    def __init__(
        self,
        point: np.ndarray,
        image: np.ndarray,
        links: np.ndarray,
        target: np.ndarray,
        directions: np.ndarray | None,
    ):
        count = len(links)
        starts = np.searchsorted(point, np.arange(count + 1))
        if directions is None:
            directions = np.tile(np.eye(2), (len(point), 1, 1))
        # Parts with about as many places each.
        share = np.arange(1, PARTS) * len(point) // PARTS
        edges = np.concatenate([[0], np.searchsorted(starts[1:], share), [count]])
        self._parts = [(part, (1,)) for part, (first, last) in enumerate(pairwise(edges)) if last > first]
        self._count, self._seen = count, len(point)
        self._fixed = [_whole(edges), _whole(starts), _whole(image), _whole(links), _exact(target), _exact(directions)]
        self._threads = resolve_threads()

    def errors(
        self, poses: tuple[np.ndarray, np.ndarray], points: np.ndarray, camera: np.ndarray, nearest: float
    ) -> np.ndarray:
        """Model less measurement, ``(O, 2)`` [px], in the directions in which it counts; infinite behind the camera.

        Args:
            poses: rotations ``(T, L, 3, 3)`` and translations ``(T, L, 3)`` of the links in the images.
            points: ``(M, 3)`` in the home posture.
            camera: focal length, principal point (x, y), bend of the lens and distance of its corner [px].
            nearest: least depth of what is before the camera.
        """
        errors: Any = wp.zeros((self._seen, 2), dtype=wp.float64, device="cpu")
        moving = [*(_exact(pose) for pose in poses), _exact(points), _exact(camera)]
        self._launch(track_errors, [*self._fixed, *moving, nearest, errors])
        return errors.numpy()

    def equations(
        self,
        poses: tuple[np.ndarray, np.ndarray],
        points: np.ndarray,
        camera: np.ndarray,
        root: np.ndarray,
        screws: np.ndarray,
        bends: bool,
    ) -> NormalEquations:
        """Normal equations: what all points share, the columns of the screws, the logarithm of the focal length and the
        bend, and blocks of 3 for the points.

        Args:
            poses, points, camera: as for :meth:`errors`.
            root: ``(O,)`` of the places' weights.
            screws: ``(L, T, 6, 3 + C)``, slopes of a row's six numbers (b, p x b), b its slopes by position, by the
                point and by C shared columns.
            bends: whether the lens's bend is asked for.
        """
        by_screws = screws.shape[3]
        columns = by_screws + 1 + bends + 1
        if columns > MOST_COLUMNS:
            raise ValueError(f"{columns} columns; expected at most {MOST_COLUMNS}")
        width = -(-columns // LANES) * LANES
        padded = np.zeros((*screws.shape[:3], width))
        padded[..., :by_screws] = screws
        own: Any = wp.zeros((self._count, 3, width), dtype=wp.float64, device="cpu")
        of_all: Any = wp.zeros((PARTS, columns - 3, width), dtype=wp.float64, device="cpu")
        moving = [*(_exact(pose) for pose in poses), _exact(points), _exact(camera)]
        settings = [_exact(root), _exact(padded), columns, by_screws, bends]
        self._launch(track_equations, [*self._fixed, *moving, *settings, own, of_all])
        shared, blocks = of_all.numpy().sum(axis=0)[:, 3:columns], own.numpy()
        equations = NormalEquations(float(shared[-1, -1]), shared[:-1, :-1].copy(), shared[:-1, -1].copy())
        equations.local = blocks[:, :, :3].copy()
        equations.coupling = blocks[:, :, 3 : columns - 1].copy()
        equations.local_gradient = blocks[:, :, columns - 1].copy()
        return equations

    def _launch(self, kernel: Any, arguments: list[Any]) -> None:
        if self._parts:
            share_out(recorded_parts(kernel, self._parts, arguments, "cpu"), min(self._threads, len(self._parts)))


def _exact(values: np.ndarray) -> Any:
    return wp.array(np.ascontiguousarray(values, dtype=np.float64), dtype=wp.float64, device="cpu", copy=False)


def _whole(values: np.ndarray) -> Any:
    return wp.array(np.ascontiguousarray(values, dtype=np.int32), dtype=int, device="cpu", copy=False)
