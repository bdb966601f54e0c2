"""Denavit-Hartenberg parameters: to and from lines, and their derivatives.

The paper's chain ends after n transforms and so cannot reach an arbitrary tool frame; here features are given in the
home pose, which stands for a free tool transform: the last row of the table only names its frame. Where two axes are
parallel, d is not determined; the conversion then takes d = 0.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.generative.least_squares.pixel_problem import NormalEquations, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.rotations import tangents

PARALLEL = 1e-6  # sine between axes


@dataclass
class DenavitHartenberg:
    """Kinematics as the paper writes them, P = B T_1(j_1) ... T_n(j_n).

    Attributes:
        base: ``(4, 4)`` B.
        table: ``(n, 4)`` rows omega [rad], d, a, alpha [rad].
    """

    base: np.ndarray
    table: np.ndarray

    def frames(self, joints: np.ndarray) -> np.ndarray:
        """Poses ``(T, n + 1, 4, 4)`` of the base and behind every joint at ``joints`` ``(T, n)`` [rad]."""
        poses = [np.broadcast_to(self.base, (len(joints), 4, 4))]
        for row, angle in zip(self.table, joints.T, strict=True):
            poses.append(poses[-1] @ transforms(row, angle))
        return np.stack(poses, axis=1)


def transforms(row: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """The paper's T of one joint at angles ``(T,)``: ``(T, 4, 4)``."""
    omega, d, a, alpha = row
    c, s, ca, sa = np.cos(omega + angles), np.sin(omega + angles), np.cos(alpha), np.sin(alpha)
    zero, one = np.zeros_like(c), np.ones_like(c)
    rows = [
        [c, -s * ca, s * sa, a * c],
        [s, c * ca, -c * sa, a * s],
        [zero, sa * one, ca * one, d * one],
        [zero, zero, zero, one],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def from_lines(axes: np.ndarray, points: np.ndarray, home: np.ndarray) -> DenavitHartenberg:
    """Parameters of a chain of lines in the pose ``home``; the last row has a frame of its own choice."""
    count = len(axes)
    x = tangents(axes[0])[0]
    origin = points[0]
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = np.stack([x, np.cross(axes[0], x), axes[0]], axis=1), origin
    table = np.zeros((count, 4))
    for i in range(count - 1):
        z, following = axes[i], axes[i + 1]
        normal = np.cross(z, following)
        between = points[i + 1] - origin
        if np.linalg.norm(normal) > PARALLEL:
            normal /= np.linalg.norm(normal)
            # Feet of the common normal: origin + d z and points[i + 1] + e following.
            d, _ = np.linalg.lstsq(
                np.stack([z, -following], axis=1), between - normal * (normal @ between), rcond=None
            )[0]
        else:
            d = 0.0
            across = between - z * (z @ between)
            normal = across / np.linalg.norm(across) if np.linalg.norm(across) > PARALLEL else x
        foot = origin + d * z
        a = float(normal @ (points[i + 1] - foot))
        table[i] = (
            np.arctan2(np.cross(x, normal) @ z, x @ normal),
            d,
            a,
            np.arctan2(np.cross(z, following) @ normal, z @ following),
        )
        x, origin = normal, foot + a * normal
    table[:, 0] -= home
    return DenavitHartenberg(base, table)


def to_lines(dh: DenavitHartenberg, home: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes and points ``(n, 3)`` in the pose ``home``, each point the one nearest to ``near`` on its line."""
    frames = dh.frames(home[None])[0]
    axes, origins = frames[:-1, :3, 2], frames[:-1, :3, 3]
    return axes, origins + axes * ((near - origins) * axes).sum(axis=1, keepdims=True)


@dataclass
class DHState(PixelState):
    """A state whose lines follow from DH parameters."""

    dh: DenavitHartenberg | None = None


class DHProblem:
    """A :class:`PixelProblem` whose kinematic unknowns are the base's pose and the first n - 1 rows of the table.

    These are 6 and 4 (n - 1) unknowns, in that order.

    By the chain rule: a parameter of row j turns or shifts all later axes together.
    """

    def __init__(self, problem: PixelProblem):
        if not problem.free.kinematics:
            raise ValueError("the problem's kinematics are not free")
        self.problem = problem
        self.lines = 4 * len(problem.columns.axes)
        self.own = 6 + 4 * (len(problem.columns.axes) - 1)

    def cost(self, state: DHState) -> float:
        """As the problem's."""
        return self.problem.cost(state)

    def linearize(self, state: DHState) -> NormalEquations:
        """Normal equations in DH parameters."""
        equations = self.problem.linearize(state)
        chain = self._chain_rule(state)
        rest = self.lines
        shared = equations.shared
        across = chain.T @ shared[:rest, rest:]
        equations.shared = np.block(
            [[chain.T @ shared[:rest, :rest] @ chain, across], [across.T, shared[rest:, rest:]]]
        )
        gradient = equations.shared_gradient
        equations.shared_gradient = np.concatenate([chain.T @ gradient[:rest], gradient[rest:]])
        if equations.coupling is not None:
            coupling = equations.coupling
            equations.coupling = np.concatenate([coupling[..., :rest] @ chain, coupling[..., rest:]], axis=2)
        return equations

    def move(self, state: DHState, shared: np.ndarray, local: np.ndarray | None = None) -> DHState:
        """The state after a step."""
        from dense_vs.generative.rotations import rotation_matrices

        assert state.dh is not None
        step = np.concatenate([np.zeros(self.lines), shared[self.own :]])
        moved = self.problem.move(state, step, local)
        base = state.dh.base.copy()
        base[:3, :3] = rotation_matrices(shared[:3]) @ base[:3, :3]
        base[:3, 3] += shared[3:6]
        table = state.dh.table.copy()
        table[:-1] += shared[6 : self.own].reshape(-1, 4)
        return with_dh(moved, DenavitHartenberg(base, table))

    def _chain_rule(self, state: DHState) -> np.ndarray:
        """Derivative of the lines' tangent parameters by the DH parameters, ``(4 n, 6 + 4 (n - 1))``."""
        assert state.dh is not None
        p = state.parameters
        count = p.joint_count
        frames = state.dh.frames(p.home[None])[0]
        twists: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]] = []  # first joint moved, turn, pivot, shift
        zero = np.zeros(3)
        twists += [(0, axis, frames[0, :3, 3], zero) for axis in np.eye(3)]
        twists += [(0, zero, zero, axis) for axis in np.eye(3)]
        for row in range(count - 1):
            z, origin = frames[row, :3, 2], frames[row, :3, 3]
            x, end = frames[row + 1, :3, 0], frames[row + 1, :3, 3]
            twists += [(row + 1, z, origin, zero), (row + 1, zero, zero, z)]
            twists += [(row + 1, zero, zero, x), (row + 1, x, end, zero)]
        across = tangents(p.axes)
        chain = np.zeros((4 * count, len(twists)))
        for column, (first, turned, pivot, shifted) in enumerate(twists):
            for joint in range(first, count):
                # A turn by s_1 e_1 + s_2 e_2 changes w by s_2 e_1 - s_1 e_2, as e_1 x w = -e_2.
                by_axis = across[joint] @ np.cross(turned, p.axes[joint])
                by_point = across[joint] @ (np.cross(turned, p.points[joint] - pivot) + shifted)
                chain[2 * joint : 2 * joint + 2, column] = -by_axis[1], by_axis[0]
                chain[2 * (count + joint) : 2 * (count + joint) + 2, column] = by_point
        return chain


def with_dh(state: PixelState, dh: DenavitHartenberg) -> DHState:
    """The state with the lines that ``dh`` says."""
    from dataclasses import replace

    p: ModelParameters = state.parameters
    axes, points = to_lines(dh, p.home, np.nanmean(p.features, axis=0))
    parameters = replace(p, axes=axes, points=points)
    return DHState(parameters, state.joints, state.rotation, state.translation, dh)
