"""Reprojection error of tracks on a chain of unknown lines: its normal equations, with the points to be eliminated.

The loss is Gothoskar (6) for one camera and points on any link. Unknown are the hinges' lines, four numbers each, the
slides' shifts, three numbers each, the focal length, the lens's bend where it is asked for, and every point's place in
the home posture, which touches no other point's pixels: ``minimize`` eliminates the points by the Schur complement.
"""

from dataclasses import dataclass, replace

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.generative.least_squares.pixel_problem import NormalEquations

NEAREST = 1e-3  # least depth of a point before the camera, in units of length
MOST_BEND = 0.15  # either way, of a lens


@dataclass(frozen=True)
class BodyState:
    """The unknowns.

    Attributes:
        chain: the joints' lines.
        points: ``(M, 3)`` in the home posture, camera frame.
        focal: focal length [px].
        bend: of the lens, see :class:`.lens.Lens`.
        moved: ``(4 N + 1,)``, all steps of the lines and of the logarithm of the focal length so far, added up.
    """

    chain: Chain
    points: np.ndarray
    focal: float
    bend: float = 0.0
    moved: np.ndarray | float = 0.0


class TrackProblem:
    """Weighted squares of the distances between tracks and model.

    Args:
        joints: ``(T, N)`` [rad].
        pixels: ``(T, M, 2)``, NaN where not seen.
        links: ``(M,)`` link of each point, -1 for the background.
        center: principal point (x, y) [px].
        weights: ``(T, M)`` of the squares.
        focal_prior: mean of the focal length [px] and the standard deviation of its logarithm; 0 holds it.
        noise: standard deviation of a track's pixel, which the priors are weighed against [px].
        bend_deviation: standard deviation of the lens's bend about 0; 0 holds it as it is.
        directions: ``(T, M, 2, 2)``, what errors are multiplied by, see :mod:`.image_directions`; 1 unless given.
        information: ``(4 N + 1, 4 N + 1)``, that there was about the state's ``moved`` before; none unless given.
    """

    def __init__(
        self,
        joints: np.ndarray,
        pixels: np.ndarray,
        links: np.ndarray,
        center: tuple[float, float],
        weights: np.ndarray,
        focal_prior: tuple[float, float],
        noise: float = 0.5,
        bend_deviation: float = 0.0,
        directions: np.ndarray | None = None,
        information: np.ndarray | None = None,
    ):
        self.joints, self.links, self.center = joints, links, np.asarray(center)
        self.bend_deviation = bend_deviation
        self.information = None if information is None else noise**2 * information
        self.image, self.point = np.nonzero(np.isfinite(pixels[..., 0]) & (weights > 0))
        order = np.lexsort((self.image, links[self.point], self.point))
        self.image, self.point = self.image[order], self.point[order]
        self.target = pixels[self.image, self.point]
        self.root = np.sqrt(weights[self.image, self.point])
        self.directions = None if directions is None else directions[self.image, self.point]
        self.link = links[self.point]
        self.count = len(links)
        self.focal_prior, self.noise = focal_prior, noise
        starts = np.flatnonzero(np.diff(self.point, prepend=-1))
        self._starts, self._present = starts, self.point[starts]

    def positions(self, state: BodyState) -> np.ndarray:
        """Where the model has the observed points, ``(O, 3)`` in the camera frame."""
        rotation, translation = state.chain.link_poses(self.joints)
        at = self.image, self.link
        return np.einsum("oij,oj->oi", rotation[at], state.points[self.point]) + translation[at]

    def errors(self, state: BodyState) -> np.ndarray:
        """Model less measurement, ``(O, 2)`` [px], in the directions in which it counts; infinite behind the camera."""
        p = self.positions(state)
        depth = np.where(p[:, 2] > NEAREST, p[:, 2], np.nan)
        seen = self._lens(state).bent(state.focal * p[:, :2] / depth[:, None] + self.center)
        return np.nan_to_num(self._directed(seen - self.target), nan=np.inf)

    def _directed(self, values: np.ndarray) -> np.ndarray:
        """Values ``(O, 2)`` or ``(O, 2, K)`` of x and y in the directions in which places count."""
        if self.directions is None:
            return values
        return (self.directions @ values.reshape(len(values), 2, -1)).reshape(values.shape)

    def cost(self, state: BodyState) -> float:
        """Sum of weighted squares [px^2]."""
        errors = self.errors(state)
        if not np.isfinite(errors).all() or state.focal <= 0:
            return np.inf
        residual = (errors * self.root[:, None]).ravel()
        return float(residual @ residual) + self._prior(state)[0] + self._bend_prior(state)[0] + self._known(state)[0]

    def linearize(self, state: BodyState) -> NormalEquations:
        """Normal equations: joints (4 N) as :meth:`.chain.Chain.moved` has them, logarithm of the focal length, the
        bend where it is asked for, and blocks of 3 for the points.
        """
        chain, joint_count = state.chain, state.chain.joint_count
        rotation, translation = chain.link_poses(self.joints)
        at = self.image, self.link
        R = rotation[at]
        p = np.einsum("oij,oj->oi", R, state.points[self.point]) + translation[at]
        scale = self.root * state.focal / p[:, 2]
        normal = p[:, :2] / p[:, 2:]
        lens, straight = self._lens(state), state.focal * normal + self.center
        bends = int(self.bend_deviation > 0)
        slopes = lens.slopes(straight) if bends or lens.bend else None
        errors = self._directed(lens.bent(straight) - self.target) * self.root[:, None]
        by_position = np.zeros((len(p), 2, 3))
        by_position[:, 0, 0] = by_position[:, 1, 1] = scale
        by_position[:, :, 2] = -normal * scale[:, None]
        by_focal = state.focal * self.root[:, None] * normal
        if slopes is not None:
            by_position = slopes @ by_position
            by_focal = np.einsum("oij,oj->oi", slopes, by_focal)
        by_position, by_focal = self._directed(by_position), self._directed(by_focal)
        shared = np.zeros((len(p), 2, 4 * joint_count + 1 + bends))
        across, moved_by, slides = chain.across, chain.moved_by, chain.slides
        for n in range(joint_count):
            chosen = np.flatnonzero(moved_by[self.link, n])
            if not len(chosen):
                continue
            image, parent = self.image[chosen], chain.parents[n]
            Ra, Rn = rotation[image, parent], rotation[image, n]
            if slides[n]:
                shift = Ra * (self.joints[image, n] - chain.home[n])[:, None, None]
                shared[chosen, :, 4 * n : 4 * n + 3] = by_position[chosen] @ shift
                continue
            z = np.einsum("oji,oj->oi", Ra, p[chosen] - translation[image, parent]) - chain.points[n]
            y = np.einsum("oji,oj->oi", Rn, p[chosen] - translation[image, n]) - chain.points[n]
            for k in range(2):
                a = across[n, k]
                turn = np.einsum("oij,oj->oi", Ra, np.cross(a, z)) - np.einsum("oij,oj->oi", Rn, np.cross(a, y))
                shift = (Ra - Rn) @ a
                shared[chosen, :, 4 * n + k] = np.einsum("oij,oj->oi", by_position[chosen], turn)
                shared[chosen, :, 4 * n + 2 + k] = np.einsum("oij,oj->oi", by_position[chosen], shift)
        shared[:, :, 4 * joint_count] = by_focal
        if bends:
            shared[:, :, -1] = self.root[:, None] * self._directed(lens.by_bend(straight))
        own = by_position @ R
        rows = shared.reshape(-1, shared.shape[2])
        equations = NormalEquations(0.0, rows.T @ rows, rows.T @ errors.ravel())
        equations.local = self._sum(np.einsum("oki,okj->oij", own, own))
        equations.local_gradient = self._sum(np.einsum("oki,ok->oi", own, errors))
        equations.coupling = self._sum(own.transpose(0, 2, 1) @ shared)
        equations.cost = float((errors**2).sum())
        priors = [self._prior(state), self._bend_prior(state)]
        for k, (cost, gradient, information) in enumerate(priors[: 1 + bends], start=4 * joint_count):
            equations.cost += cost
            equations.shared[k, k] += information
            equations.shared_gradient[k] += gradient
        if self.information is not None:
            cost, pull = self._known(state)
            equations.cost += cost
            equations.shared[: len(pull), : len(pull)] += self.information
            equations.shared_gradient[: len(pull)] += pull
        return equations

    def move(self, state: BodyState, shared: np.ndarray, local: np.ndarray | None = None) -> BodyState:
        """The state after a step of the unknowns."""
        joint_count = state.chain.joint_count
        chain = state.chain.moved(shared[: 4 * joint_count].reshape(joint_count, 4))
        focal, *bend = shared[4 * joint_count :]
        return replace(
            state,
            chain=chain,
            focal=state.focal * float(np.exp(np.clip(focal, -0.5, 0.5))),
            bend=float(np.clip(state.bend + sum(bend), -MOST_BEND, MOST_BEND)),
            moved=state.moved + shared[: 4 * joint_count + 1],
            points=state.points + (0.0 if local is None else local),
        )

    def _prior(self, state: BodyState) -> tuple[float, float, float]:
        """Cost, half its gradient and half its curvature by the logarithm of the focal length."""
        mean, deviation = self.focal_prior
        information = (self.noise / max(deviation, 1e-6)) ** 2
        off = float(np.log(max(state.focal, 1e-9) / mean))
        return information * off * off, information * off, information

    def _bend_prior(self, state: BodyState) -> tuple[float, float, float]:
        """The same by the bend; 0 where it is held."""
        if not self.bend_deviation > 0:
            return 0.0, 0.0, 0.0
        information = (self.noise / self.bend_deviation) ** 2
        return information * state.bend**2, information * state.bend, information

    def _known(self, state: BodyState) -> tuple[float, np.ndarray]:
        """Cost and half its gradient by what was known before."""
        if self.information is None:
            return 0.0, np.zeros(0)
        moved = np.broadcast_to(state.moved, len(self.information))
        pull = self.information @ moved
        return float(moved @ pull), pull

    def _lens(self, state: BodyState) -> Lens:
        return Lens.of_center(self.center, state.bend)

    def _sum(self, values: np.ndarray) -> np.ndarray:
        """Sums of the observations' values over each point."""
        total = np.zeros((self.count, *values.shape[1:]))
        if len(values):
            total[self._present] = np.add.reduceat(values, self._starts, axis=0)
        return total
