"""Which link every track is on: the one whose motion explains its pixels best.

For every track and every link the point is placed by Gauss and Newton's method, with the chain as it is, and the robust
error of what remains decides. The background is the link that nothing moves.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.track_problem import NEAREST

_ITERATIONS = 6
_ROW, _COLUMN = np.triu_indices(3)
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
    seen = _Observations(chain, focal, center, joints, pixels, links, noise, directions)
    points, damping = np.array(start, dtype=float), np.full(len(links), 1e-3)
    here = seen.of(points)
    cost = seen.robust(here)
    for _ in range(_ITERATIONS):
        matrix, gradient = seen.equations(here)
        diagonal = np.einsum("mii->mi", matrix).copy()
        matrix[:, range(3), range(3)] += damping[:, None] * diagonal + 1e-9 * (1 + diagonal.max(axis=1, keepdims=True))
        trial = points - np.linalg.solve(matrix, gradient[..., None])[..., 0]
        there = seen.of(trial)
        trial_cost = seen.robust(there)
        better = trial_cost <= cost
        points[better], cost[better] = trial[better], trial_cost[better]
        damping = np.where(better, damping / 5, damping * 10)
        here = np.where(better[seen.point], there, here)
    errors = np.full(pixels.shape[:2], np.nan)
    errors[seen.image, seen.point] = np.minimum(np.hypot(here[3], here[4]), 1e6)
    return Placed(points, cost, errors)


class _Observations:
    """The O pixels of points on given links; the arguments are those of :func:`place_points`."""

    def __init__(
        self,
        chain: Chain,
        focal: float,
        center: tuple[float, float],
        joints: np.ndarray,
        pixels: np.ndarray,
        links: np.ndarray,
        noise: float,
        directions: np.ndarray | None,
    ):
        image, point = np.nonzero(np.isfinite(pixels[..., 0]))
        order = np.argsort(point, kind="stable")
        self.image, self.point = image[order], point[order]
        self.focal, self.noise, self.count = focal, noise, len(links)
        self._from_center = pixels[self.image, self.point].T - np.array(center)[:, None]
        self._directions = None
        if directions is not None:
            self._directions = directions[self.image, self.point].transpose(1, 2, 0).copy()
        rotation, translation = chain.link_poses(joints)
        at = self.image, links[self.point]
        self._rotation, self._translation = rotation[at], translation[at].T
        self._axes = self._rotation.transpose(1, 2, 0).copy()  # rows x, y, z, each (3, O)
        self._starts = np.flatnonzero(np.diff(self.point, prepend=-1))
        self._present = self.point[self._starts]
        self._seen = np.maximum(np.bincount(self.point, minlength=self.count), 1)

    def of(self, points: np.ndarray) -> np.ndarray:
        """Normalized x and y, depth, errors in x and y [px], and squared error over the noise: ``(6, O)``."""
        p = np.einsum("oij,oj->io", self._rotation, points[self.point]) + self._translation
        depth = np.maximum(p[2], NEAREST)
        normal = p[:2] / depth
        errors = self._directed(*(self.focal * normal - self._from_center))
        squared = np.where(p[2] > NEAREST, errors[0] ** 2 + errors[1] ** 2, np.inf) / self.noise**2
        return np.array([*normal, depth, *errors, squared])

    def robust(self, observed: np.ndarray) -> np.ndarray:
        """Mean robust error ``(M,)`` of each point, 0 to 1."""
        return self._total(1 - 1 / (1 + observed[5] / _GROSS**2)) / self._seen

    def equations(self, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix ``(M, 3, 3)`` and gradient ``(M, 3)`` of each point's home position."""
        x, y, depth, *errors, squared = observed
        root = 1 / (1 + np.nan_to_num(squared, posinf=1e12) / _GROSS**2)  # of the weights of Geman and McClure
        scale = root * self.focal / depth
        along_x, along_y, along_z = self._axes
        of_x, of_y = self._directed(scale * (along_x - x * along_z), scale * (along_y - y * along_z))
        products = of_x[_ROW] * of_x[_COLUMN] + of_y[_ROW] * of_y[_COLUMN]
        sums = self._total(np.concatenate([products, root * (of_x * errors[0] + of_y * errors[1])])).T
        matrix = np.empty((self.count, 3, 3))
        matrix[:, _ROW, _COLUMN] = matrix[:, _COLUMN, _ROW] = sums[:, :6]
        return matrix, sums[:, 6:]

    def _directed(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values ``(..., O)`` of x and y in the directions in which places count."""
        if self._directions is None:
            return x, y
        (a, b), (c, d) = self._directions
        return a * x + b * y, c * x + d * y

    def _total(self, values: np.ndarray) -> np.ndarray:
        """Sums ``(..., M)`` of the observations' values ``(..., O)`` over each point."""
        out = np.zeros((*values.shape[:-1], self.count))
        if len(self._present):
            out[..., self._present] = np.add.reduceat(values, self._starts, axis=-1)
        return out
