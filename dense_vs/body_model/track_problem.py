"""Reprojection error of tracks on a chain of unknown lines: its normal equations, with the points to be eliminated.

The loss is Gothoskar (6) for one camera and points on any link. Unknown are the hinges' lines, four numbers each, the
slides' shifts, three numbers each, the focal length, the lens's bend where it is asked for, and every point's place in
the home posture, which touches no other point's pixels: ``minimize`` eliminates the points by the Schur complement.
"""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.observed_places import ObservedPlaces
from dense_vs.body_model.track_observations import TrackObservations
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
        self.point, self.image = np.nonzero((np.isfinite(pixels[..., 0]) & (weights > 0)).T)  # point by point
        self.target = pixels[self.image, self.point]
        self.root = np.sqrt(weights[self.image, self.point])
        self.directions = None if directions is None else directions[self.image, self.point]
        self.link = links[self.point]
        self.count = len(links)
        self.focal_prior, self.noise = focal_prior, noise
        on_links = links % (joints.shape[1] + 1)
        seen = ObservedPlaces(self.point, self.image, on_links, self.target, self.directions)
        self._observed = TrackObservations(seen)

    def weighted(self, weights: np.ndarray) -> "TrackProblem":
        """The same of other weights ``(O,)`` of its observations' squares, above 0."""
        other = copy(self)
        other.root = np.sqrt(weights)
        return other

    def errors(self, state: BodyState) -> np.ndarray:
        """Model less measurement, ``(O, 2)`` [px], in the directions in which it counts; infinite behind the camera."""
        return self._observed.errors(state.chain.link_poses(self.joints), state.points, self._camera(state), NEAREST)

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
        poses = state.chain.link_poses(self.joints)
        joint_count, bends = state.chain.joint_count, int(self.bend_deviation > 0)
        screws = self._screws(state.chain, *poses)
        equations = self._observed.equations(poses, state.points, self._camera(state), self.root, screws, bends > 0)
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

    def _screws(self, chain: Chain, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
        """Slopes ``(L, T, 6, 3 + 4 N)`` of a row (b, p x b) by each point's home position and by the joints.

        A turn of joint n's line about its point, at w in an image, moves a point p by d x (p - w) and a shift by d,
        with d the difference of the turn's axis, or the shift, as the joint's parent and the joint itself carry it. For
        a row b of the slopes by position, b . (d x p) is d . (p x b): so one product of the six numbers (b, p x b) with
        those of an image and a link gives all joints' columns.
        """
        images, joint_count = len(self.joints), chain.joint_count
        carried = rotation[:, chain.parents]  # (T, N, 3, 3)
        across = np.swapaxes(chain.across, 1, 2)  # (N, 3, 2)
        d = (carried - rotation[:, :-1]) @ across  # (T, N, 3, 2)
        line = (carried @ chain.points[:, :, None])[..., 0] + translation[:, chain.parents]
        screws = np.zeros((images, 6, joint_count, 4))
        screws[:, :3, :, :2] = np.cross(line[..., None], d, axisa=2, axisb=2, axisc=2).swapaxes(1, 2)
        screws[:, 3:, :, :2] = screws[:, :3, :, 2:] = d.swapaxes(1, 2)
        since = self.joints - chain.home
        for n in np.flatnonzero(chain.slides):
            screws[:, :, n] = 0.0
            screws[:, :3, n, :3] = carried[:, n] * since[:, n, None, None]
        on_link = np.zeros((len(chain.moved_by), images, 6, 3 + 4 * joint_count))
        on_link[:, :, :3, :3] = rotation.swapaxes(0, 1)
        on_link[:, :, :, 3:] = (screws * chain.moved_by[:, None, None, :, None]).reshape(len(on_link), images, 6, -1)
        return on_link

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

    def _camera(self, state: BodyState) -> np.ndarray:
        """Focal length, principal point, bend, and distance of the corner that it is told of."""
        lens = Lens.of_center(self.center, state.bend)
        return np.array([state.focal, *lens.center, lens.bend, lens.corner])
