"""Errors of what was seen of points of a body, and the normal equations of their bundle adjustment."""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.body_model.observed_places import PARTS, ObservedPlaces, on_cpu
from dense_vs.generative.least_squares.pixel_problem import NormalEquations
from dense_vs.kernels.body.track_equations import LANES, track_equations, track_errors


class TrackObservations:
    """What a chain should explain.

    Args:
        seen: the places, as seen in the images.
    """

    def __init__(self, seen: ObservedPlaces):
        self._seen = seen

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
        errors: Any = wp.zeros((self._seen.place_count, 2), dtype=wp.float64, device="cpu")
        self._seen.launch(track_errors, poses, [on_cpu(points, wp.vec3d), on_cpu(camera), nearest, errors])
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
        width = -(-columns // LANES) * LANES
        padded = np.zeros((*screws.shape[:3], width))
        padded[..., :by_screws] = screws
        shapes = (PARTS, 2, width), (self._seen.point_count, 3, width), (PARTS, columns - 3, width)
        out: list[Any] = [wp.zeros(shape, dtype=wp.float64, device="cpu") for shape in shapes]
        settings = [on_cpu(root), on_cpu(padded), columns, by_screws, bends]
        self._seen.launch(track_equations, poses, [on_cpu(points, wp.vec3d), on_cpu(camera), *settings, *out])
        own, of_all = out[1:]
        shared, blocks = of_all.numpy().sum(axis=0)[:, 3:columns], own.numpy()
        equations = NormalEquations(float(shared[-1, -1]), shared[:-1, :-1].copy(), shared[:-1, -1].copy())
        equations.local = blocks[:, :, :3].copy()
        equations.coupling = blocks[:, :, 3 : columns - 1].copy()
        equations.local_gradient = blocks[:, :, columns - 1].copy()
        return equations
