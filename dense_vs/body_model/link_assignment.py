"""Which link every track is on: the one whose motion explains its pixels best.

For every track and every link the point is placed by Gauss and Newton's method, with the chain as it is, and the robust
error of what remains decides. The background is the link that nothing moves.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.track_problem import NEAREST

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
    image, point = np.nonzero(np.isfinite(pixels[..., 0]))
    order = np.argsort(point, kind="stable")
    image, point = image[order], point[order]
    target = pixels[image, point]
    directed = None if directions is None else directions[image, point]
    rotation, translation = chain.link_poses(joints)
    R, t = rotation[image, links[point]], translation[image, links[point]]
    starts = np.flatnonzero(np.diff(point, prepend=-1))
    present = point[starts]
    count = len(links)
    seen = np.bincount(point, minlength=count)

    def total(values: np.ndarray) -> np.ndarray:
        out = np.zeros((count, *values.shape[1:]))
        if len(values):
            out[present] = np.add.reduceat(values, starts, axis=0)
        return out

    def evaluate(points: np.ndarray):
        p = np.einsum("oij,oj->oi", R, points[point]) + t
        depth = np.maximum(p[:, 2], NEAREST)
        normal = p[:, :2] / depth[:, None]
        error = focal * normal + center - target
        if directed is not None:
            error = (directed @ error[..., None])[..., 0]
        squared = np.where(p[:, 2] > NEAREST, (error**2).sum(axis=1), np.inf) / noise**2
        return depth, normal, error, squared

    def robust(squared: np.ndarray) -> np.ndarray:
        return total(1 - 1 / (1 + squared / _GROSS**2)) / np.maximum(seen, 1)

    points, damping = np.array(start, dtype=float), np.full(count, 1e-3)
    depth, normal, error, squared = evaluate(points)
    cost = robust(squared)
    for _ in range(_ITERATIONS):
        root = 1 / (1 + np.nan_to_num(squared, posinf=1e12) / _GROSS**2)  # of the weights of Geman and McClure
        scale = root * focal / depth
        by_position = np.zeros((len(point), 2, 3))
        by_position[:, 0, 0] = by_position[:, 1, 1] = scale
        by_position[:, :, 2] = -normal * scale[:, None]
        own = by_position @ R if directed is None else directed @ by_position @ R
        matrix = total(np.einsum("oki,okj->oij", own, own))
        gradient = total(np.einsum("oki,ok->oi", own, error * root[:, None]))
        diagonal = np.einsum("mii->mi", matrix)
        matrix[:, range(3), range(3)] += damping[:, None] * diagonal + 1e-9 * (1 + diagonal.max(axis=1, keepdims=True))
        trial = points - np.linalg.solve(matrix, gradient[..., None])[..., 0]
        found = evaluate(trial)
        trial_cost = robust(found[3])
        better = trial_cost <= cost
        points[better] = trial[better]
        damping = np.where(better, damping / 5, damping * 10)
        depth, normal, error, squared = evaluate(points)
        cost = robust(squared)
    errors = np.full(pixels.shape[:2], np.nan)
    errors[image, point] = np.minimum(np.linalg.norm(error, axis=1), 1e6)
    return Placed(points, cost, errors)
