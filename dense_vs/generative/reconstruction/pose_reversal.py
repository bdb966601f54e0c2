"""The hand's other pose in each sample: seen from afar, a flat structure and the same reversed in depth look alike.

Beyond the paper. A sample whose features are seen by one camera, or by each only in part, may be posed the wrong way
round at first (Oberkampf, DeMenthon and Davis 1996, for planar targets), and bundle adjustment stays in that minimum.
Both are tried to the end, and the pixels decide.
"""

from dataclasses import replace

import numpy as np

from dense_vs.generative.least_squares.pixel_problem import PixelProblem, PixelState
from dense_vs.generative.reconstruction.triangulation import rigid_motions

ITERATIONS = 12
GAIN = 0.05  # share of the squared errors that another pose must save


def better_poses(problem: PixelProblem, state: PixelState) -> tuple[PixelState, np.ndarray]:
    """Each sample's better pose of the two, and in which samples ``(T,)`` it is the other one.

    Args:
        problem: with a free pose in each sample and nothing else free.
        state: its solution.
    """
    _, cost = settle_poses(problem, state, iterations=0)
    other, other_cost = settle_poses(problem, reversed_state(problem, state))
    better = other_cost < cost * (1 - GAIN)
    return _with_poses(state, other, better), better


def reversed_state(problem: PixelProblem, state: PixelState) -> PixelState:
    """Poses that show the visible features with their depths reversed, as nearly as a rigid motion can."""
    parameters = state.parameters
    assert state.rotation is not None
    assert state.translation is not None
    rotation, translation = state.rotation.copy(), state.translation.copy()
    samples = np.arange(len(rotation))
    camera = np.argmax(problem.seen.sum(axis=2), axis=1)  # that sees most, in each sample
    visible = problem.seen[samples, camera]
    able = visible.sum(axis=1) >= 3
    view = parameters.camera_rotation[camera]
    places = np.einsum("tij,mj->tmi", view @ rotation, parameters.features)
    middle = (places * visible[..., None]).sum(axis=1) / np.maximum(visible.sum(axis=1), 1)[:, None]
    mirrored = (places - middle[:, None]) * [1.0, 1.0, -1.0] + middle[:, None]
    turned, shifted = rigid_motions(parameters.features[None], mirrored, np.where(able[:, None], visible, 1.0))
    back = view.swapaxes(1, 2)
    # About the visible features' middle: the hand's place in the camera's axes stays in depth.
    rotation[able] = (back @ turned)[able]
    translation[able] += np.einsum("tij,tj->ti", back, shifted)[able]
    return replace(state, rotation=rotation, translation=translation)


def settle_poses(
    problem: PixelProblem, state: PixelState, iterations: int = ITERATIONS
) -> tuple[PixelState, np.ndarray]:
    """Levenberg-Marquardt of every sample's pose by itself; squared errors ``(T,)`` [px^2] beside the state.

    They are infinite where a feature would stand behind its camera.
    """
    damping = np.full(len(problem.seen), 1e-3)
    cost = _costs(problem, state)
    nothing = np.zeros(problem.count)
    diagonal = np.arange(6)
    for _ in range(iterations):
        equations = problem.linearize(state)
        assert equations.local is not None
        assert equations.local_gradient is not None
        blocks, gradient = equations.local.copy(), equations.local_gradient
        usable = np.isfinite(blocks).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1) & np.isfinite(cost)
        blocks[~usable], gradient = np.eye(6), np.where(usable[:, None], gradient, 0.0)
        blocks[:, diagonal, diagonal] *= 1 + damping[:, None]
        blocks[:, diagonal, diagonal] += 1e-9 * (1 + blocks[:, diagonal, diagonal].max(axis=1, keepdims=True))
        moved = problem.move(state, nothing, -np.linalg.solve(blocks, gradient[..., None])[..., 0])
        moved_cost = _costs(problem, moved)
        better = moved_cost < cost
        damping = np.clip(np.where(better, damping / 3, damping * 4), 1e-9, 1e9)
        gained = cost[better] - moved_cost[better]
        state = _with_poses(state, moved, better)
        cost = np.where(better, moved_cost, cost)
        if better.any() and not (gained > 1e-3 * cost[better]).any():
            break
    return state, cost


def _with_poses(state: PixelState, other: PixelState, which: np.ndarray) -> PixelState:
    """The first state, with the other's poses in some samples ``(T,)``."""
    assert state.rotation is not None
    assert state.translation is not None
    assert other.rotation is not None
    assert other.translation is not None
    rotation = np.where(which[:, None, None], other.rotation, state.rotation)
    return replace(state, rotation=rotation, translation=np.where(which[:, None], other.translation, state.translation))


def _costs(problem: PixelProblem, state: PixelState) -> np.ndarray:
    """Weighted squared errors of each sample [px^2]."""
    squares = (problem.residuals(state).reshape(len(problem.seen), -1) ** 2).sum(axis=1)
    return np.where(np.isfinite(squares), squares, np.inf)
