"""Which link every track is on: the one whose motion explains its pixels best.

For every track and every link the point is placed by Gauss and Newton's method, with the chain as it is, and the robust
error of what remains decides. The background is the link that nothing moves.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.track_problem import NEAREST
from dense_vs.device import resolve_threads
from dense_vs.kernels.body.point_placement import place_points as kernel
from dense_vs.kernels.launch import recorded_parts, share_out

_ITERATIONS = 6
_PARTS = 8  # of the points, that threads share out
_GROSS = 3.0  # times the noise: errors beyond count hardly more


@dataclass(frozen=True)
class Placed:
    """Points placed on one link each.

    Attributes:
        points: ``(M, 3)`` in the home posture.
        cost: ``(M,)`` mean robust squared error over the noise, 1 for errors that are all gross.
        errors: ``(T, M)`` distances [px], NaN where not seen.
    """

    points: np.ndarray
    cost: np.ndarray
    errors: np.ndarray


def place_points(
    chain: Chain,
    focal: float,
    center: tuple[float, float],
    joints: np.ndarray,
    pixels: np.ndarray,
    links: np.ndarray,
    start: np.ndarray,
    noise: float,
    directions: np.ndarray | None = None,
) -> Placed:
    """Place M points on given links.

    Args:
        chain: the joints' lines.
        focal, center: of the camera [px].
        joints: ``(T, N)`` [rad].
        pixels: ``(T, M, 2)``, NaN where not seen.
        links: ``(M,)``.
        start: ``(M, 3)`` home positions to start from.
        noise: standard deviation of a pixel [px].
        directions: ``(T, M, 2, 2)``, what errors are multiplied by, see :mod:`.image_directions`; 1 unless given.
    """
    image, point = np.nonzero(np.isfinite(pixels[..., 0]))
    order = np.argsort(point, kind="stable")
    image, point = image[order], point[order]
    if directions is None:
        directions = np.broadcast_to(np.eye(2), (*pixels.shape[:2], 2, 2))
    rotation, translation = chain.link_poses(joints)
    points, count = _array(start, wp.vec3d).numpy().copy(), len(links)
    cost, errors = np.zeros(count), np.zeros(len(point))
    arguments = [
        _array(np.searchsorted(point, np.arange(count + 1)), wp.int32),
        _array(image, wp.int32),
        _array(links % rotation.shape[1], wp.int32),
        _array(pixels[image, point] - np.array(center), wp.vec2d),
        _array(directions[image, point], wp.mat22d),
        _array(rotation, wp.mat33d),
        _array(translation, wp.vec3d),
        focal, noise, _GROSS, NEAREST, _ITERATIONS,
        _array(points, wp.vec3d), _array(cost, wp.float64), _array(errors, wp.float64),
    ]  # fmt: skip
    if count:
        edges = sorted({count * part // _PARTS for part in range(_PARTS + 1)})
        parts = [(first, (last - first,)) for first, last in pairwise(edges)]
        share_out(recorded_parts(kernel, parts, arguments, "cpu"), min(resolve_threads(), len(parts)))
    of_image = np.full(pixels.shape[:2], np.nan)
    of_image[image, point] = errors
    return Placed(points, cost, of_image)


def _array(values: np.ndarray, dtype: Any) -> Any:
    """On the CPU, the same memory where it is laid out so."""
    kind = np.int32 if dtype is wp.int32 else np.float64
    return wp.array(np.ascontiguousarray(values, dtype=kind), dtype=dtype, device="cpu", copy=False)
