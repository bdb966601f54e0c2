"""Axes and depths from J at one posture: where the fit starts.

A joint with the line (w, m), of unit direction w and moment m = c x w, moves a point X of its link by w x X + m. With
x, y the point's normalized image coordinates, r = (x, y, 1) and rho = 1 / Z its inverse depth, its column of J is

    J_n = f (A w_n + rho B m_n),   B = [[1, 0, -x], [0, 1, -y]],   A = [[-x y, 1 + x^2, -y], [-1 - y^2, x y, x]],

the interaction matrix of a point, its sign turned as the point moves and not the camera. |w| = 1 as the joint's angle
is known; of a slide w is zero and m is its shift. rho is shared by all of the point's columns: with known w and m every
rho follows from a linear equation, with known rho every (w, m) does. Scaling all moments by s and all rho by 1 / s
changes nothing, the one thing that stays open. The problem is solved by Levenberg-Marquardt over lines, with the
inverse depths eliminated, from many random directions.
"""

from dataclasses import dataclass, replace

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.solver import solve
from dense_vs.body_model.track_jacobian import TrackJacobians
from dense_vs.generative.least_squares.pixel_problem import NormalEquations
from dense_vs.generative.rotations import tangents

_NEAR, _FAR = 0.2, 5.0  # bounds on rho, whose median is 1


@dataclass(frozen=True)
class AxesState:
    """Lines at the posture of J, and the inverse depth ``(M,)`` of every point."""

    chain: Chain
    inverse_depths: np.ndarray


def interaction(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the module's docstring, ``(M, 2, 3)`` each, at normalized image coordinates ``(M, 2)``."""
    x, y = normal[:, 0], normal[:, 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    turn = np.stack([np.stack([-x * y, 1 + x * x, -y], axis=1), np.stack([-1 - y * y, x * y, x], axis=1)], axis=1)
    shift = np.stack([np.stack([one, zero, -x], axis=1), np.stack([zero, one, -y], axis=1)], axis=1)
    return turn, shift


class AxesProblem:
    """Weighted squares of J less that of lines and inverse depths.

    Args:
        normal: ``(M, 2)`` normalized image coordinates.
        jacobians: ``(M, 2, N)`` over the focal length.
        moved_by: bool ``(M, N)``; the other columns do not count.
        weights: ``(M, N)`` of the squares.
    """

    def __init__(self, normal: np.ndarray, jacobians: np.ndarray, moved_by: np.ndarray, weights: np.ndarray):
        self.turn, self.shift = interaction(normal)
        self.target = jacobians
        self.root = np.sqrt(np.where(moved_by, weights, 0.0))

    def residuals(self, state: AxesState) -> np.ndarray:
        """``(M, 2, N)``, weighted."""
        moments = np.cross(state.chain.points, state.chain.axes) + state.chain.travel
        model = self.turn @ state.chain.axes.T + state.inverse_depths[:, None, None] * (self.shift @ moments.T)
        return (model - self.target) * self.root[:, None, :]

    def cost(self, state: AxesState) -> float:
        """Sum of squares; a weak pull of the inverse depths towards 1 holds the scale."""
        if (state.inverse_depths < _NEAR).any() or (state.inverse_depths > _FAR).any():
            return np.inf
        return float((self.residuals(state) ** 2).sum()) + self.pull * float(((state.inverse_depths - 1) ** 2).sum())

    @property
    def pull(self) -> float:
        """Weight of the pull."""
        return 1e-3 * float((self.root**2).mean()) * float((self.target**2).mean())

    def linearize(self, state: AxesState) -> NormalEquations:
        """Normal equations: lines as :meth:`.chain.Chain.moved` has them, inverse depths as blocks of 1."""
        chain, rho = state.chain, state.inverse_depths
        residual = self.residuals(state)
        joints, points = chain.joint_count, len(rho)
        moments = np.cross(chain.points, chain.axes) + chain.travel
        by_axis = np.cross(chain.across, chain.axes[:, None])  # (N, 2, 3)
        by_moment = np.cross(chain.points[:, None], by_axis)
        # A joint's column of J follows its own line alone: slopes (N, M, 2, 4), the normal matrix in blocks of 4.
        near = rho[:, None, None] * self.shift
        slopes = np.zeros((joints, points, 2, 4))
        slopes[..., :2] = self.turn @ by_axis.swapaxes(1, 2)[:, None] + near @ by_moment.swapaxes(1, 2)[:, None]
        slopes[..., 2:] = near @ by_axis.swapaxes(1, 2)[:, None]
        slopes[chain.slides, ..., :3], slopes[chain.slides, ..., 3] = near, 0.0
        slopes *= self.root.T[:, :, None, None]
        own = (self.shift @ moments.T) * self.root[:, None, :]
        rows = slopes.reshape(joints, 2 * points, 4)
        gradient = rows.swapaxes(1, 2) @ residual.transpose(2, 0, 1).reshape(joints, -1, 1)
        matrix = np.zeros((joints, 4, joints, 4))
        matrix[range(joints), :, range(joints)] = rows.swapaxes(1, 2) @ rows
        equations = NormalEquations(self.cost(state), matrix.reshape(4 * joints, -1), gradient.ravel())
        equations.local = ((own**2).sum(axis=(1, 2)) + self.pull)[:, None, None]
        equations.local_gradient = ((own * residual).sum(axis=(1, 2)) + self.pull * (rho - 1))[:, None]
        equations.coupling = np.einsum("min,nmik->mnk", own, slopes).reshape(points, 1, -1)
        return equations

    def move(self, state: AxesState, shared: np.ndarray, local: np.ndarray | None = None) -> AxesState:
        """The state after a step."""
        rho = state.inverse_depths + (0.0 if local is None else local[:, 0])
        return AxesState(state.chain.moved(shared.reshape(-1, 4)), np.clip(rho, _NEAR, _FAR))

    def chain_for(self, axes: np.ndarray, home: np.ndarray, parents: np.ndarray) -> Chain:
        """Lines with the given directions ``(N, 3)``, and shifts where these are zero, that fit best at the depth 1."""
        points, travel = np.zeros_like(axes), np.zeros_like(axes)
        for n, axis in enumerate(axes):
            across = tangents(axis[None])[0] if axis.any() else np.eye(3)
            moments = np.cross(across, axis) if axis.any() else across
            columns = (self.shift @ moments.T) * self.root[:, n, None, None]
            right = (self.target[:, :, n] - self.turn @ axis) * self.root[:, n, None]
            found = np.linalg.lstsq(columns.reshape(-1, len(across)), right.ravel(), rcond=None)[0]
            (points if axis.any() else travel)[n] = found @ across
        return Chain(axes, points, home, parents, travel)


def axes_from_jacobian(
    measured: TrackJacobians,
    moved_by: np.ndarray,
    parents: np.ndarray,
    focal: float,
    center: tuple[float, float],
    *,
    slides: np.ndarray | None = None,
    starts: int = 30,
    keep: int = 10,
    seed: int = 0,
) -> list[tuple[float, AxesState]]:
    """Lines and inverse depths that explain J, the best first.

    Args:
        measured: J of M tracks.
        moved_by: bool ``(M, N)``, which joints move each, as decided.
        parents: ``(N,)`` of the joints.
        focal: focal length [px].
        center: principal point [px].
        slides: bool ``(N,)``, the joints that slide; all turn unless given.
        starts: random directions tried.
        keep: solutions to return.
        seed: of those.

    Returns:
        (cost, state) with the lines in ``measured.posture``.
    """
    rng = np.random.default_rng(seed)
    normal = (measured.places - center) / focal
    variance = np.einsum("mnn->mn", measured.covariances) + (0.05 * np.linalg.norm(measured.jacobians, axis=1)) ** 2
    problem = AxesProblem(normal, measured.jacobians / focal, moved_by, 1.0 / np.maximum(variance, 1.0))
    joints = len(parents)
    found: list[tuple[float, AxesState]] = []
    for _ in range(starts):
        axes = rng.normal(size=(joints, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        if slides is not None:
            axes[slides] = 0.0
        chain = problem.chain_for(axes, measured.posture, parents)
        state, cost = solve(problem, AxesState(chain, np.ones(len(normal))), 15, 1e-4)
        found.append((cost, state))
    found.sort(key=lambda one: one[0])
    refined = []
    for _, begun in found[:keep]:
        state, cost = solve(problem, begun, 40, 1e-5)
        refined.append((cost, state))
    refined.sort(key=lambda one: one[0])
    return refined


def with_median_one(state: AxesState) -> AxesState:
    """The same in the unit of length in which the median depth is 1."""
    median = float(np.median(state.inverse_depths))
    return replace(state, chain=state.chain.scaled(median), inverse_depths=state.inverse_depths / median)
