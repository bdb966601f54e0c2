"""Which link every track is on: the one whose motion explains its pixels best.

For every track and every link the point is placed by Gauss and Newton's method, with the chain as it is, and the robust
error of what remains decides. The background is the link that nothing moves.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.observed_places import ObservedPlaces, on_cpu
from dense_vs.body_model.track_problem import NEAREST
from dense_vs.kernels.body.point_placement import place_points as kernel

_ITERATIONS = 6
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
    point, image = np.nonzero(np.isfinite(pixels[..., 0]).T)  # point by point
    poses = chain.link_poses(joints)
    turned = None if directions is None else directions[image, point]
    seen = ObservedPlaces(point, image, links % poses[0].shape[1], pixels[image, point] - np.array(center), turned)
    points, cost, errors = np.array(start, dtype=np.float64), np.zeros(len(links)), np.zeros(len(point))
    out = on_cpu(points, wp.vec3d), on_cpu(cost), on_cpu(errors)
    seen.launch(kernel, poses, [focal, noise, _GROSS, NEAREST, _ITERATIONS, *out])
    of_image = np.full(pixels.shape[:2], np.nan)
    of_image[image, point] = errors
    return Placed(points, cost, of_image)
