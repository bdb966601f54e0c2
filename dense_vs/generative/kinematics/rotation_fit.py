"""Stage 2, first half: axis directions from the hand's rotations alone, from several starts at once.

Beyond the paper, which fits all DH parameters to the poses from one random start, Gothoskar (4), Gothoskar (5): the
rotations hold only 2 n + 3 of the unknowns, directions of the axes and the hand's home rotation, and from random
directions most starts reach the same minimum. Some starts come from regressing the rotation vectors on the joints,
right for small motion.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.generative.rotations import rotation_matrices, rotation_vectors, tangents
from dense_vs.kernels.arm.rotation_chain import RotationChain

REFINED_MINIMA = 4
DISTINCT = 1e-3  # relative difference of costs below which two ends count as the same minimum


@dataclass
class RotationMinimum:
    """One minimum: unit axes ``(n, 3)``, home rotation ``(3, 3)``, and the RMS rotation error [rad]."""

    axes: np.ndarray
    home: np.ndarray
    rms: float


def fit_rotations(
    joints: np.ndarray,
    rotations: np.ndarray,
    rng: np.random.Generator,
    weights: np.ndarray | None = None,
    starts: int = 24,
    max_iterations: int = 100,
    given: list[tuple[np.ndarray, np.ndarray]] | None = None,
) -> list[RotationMinimum]:
    """Distinct minima, best first.

    Args:
        joints: ``(T, n)`` [rad] from the home pose.
        rotations: ``(T, 3, 3)`` of the hand.
        rng: draws the starts.
        weights: ``(T,)`` of the samples.
        starts: trials, all advanced at once.
        max_iterations: steps of each at most.
        given: further starts, (axes, home).
    """
    count = joints.shape[1]
    weights = np.ones(len(joints)) if weights is None else weights
    axes, home = np.zeros((0, count, 3)), np.zeros((0, 3, 3))
    if starts > 0:
        axes, home = _starts(joints, rotations, rng, starts)
    for trial_axes, trial_home in given or []:
        axes, home = np.concatenate([axes, trial_axes[None]]), np.concatenate([home, trial_home[None]])
    trials = len(axes)
    chain = RotationChain(trials, joints, rotations, weights)
    damping, growth = np.full(trials, 1e-2), np.full(trials, 2.0)
    across = tangents(axes)
    cost, gradient, matrix = _equations(chain, axes, across, home)
    active = np.ones(trials, dtype=bool)
    diagonal = np.arange(2 * count + 3)
    for _ in range(max_iterations):
        on = np.flatnonzero(active)
        if len(on) == 0:
            break
        scale = np.maximum(matrix[on][:, diagonal, diagonal], 1e-9)
        damped = matrix[on].copy()
        damped[:, diagonal, diagonal] += damping[on, None] * scale
        step = np.linalg.solve(damped, gradient[on][..., None])[..., 0]
        predicted = (step * (damping[on, None] * scale * step + gradient[on])).sum(axis=1)
        new_axes, new_home = _move(axes[on], across[on], home[on], step)
        new_across = tangents(new_axes)
        new_cost, new_gradient, new_matrix = _equations(chain, new_axes, new_across, new_home)
        gain = (cost[on] - new_cost) / np.maximum(predicted, 1e-300)
        better = gain > 0
        took = on[better]
        done = predicted < 1e-8 * cost[on] + 1e-16
        axes[took], home[took], across[took] = new_axes[better], new_home[better], new_across[better]
        cost[took], gradient[took], matrix[took] = new_cost[better], new_gradient[better], new_matrix[better]
        damping[took] *= np.maximum(1 / 3, 1 - (2 * np.minimum(gain[better], 2) - 1) ** 3)
        growth[took] = 2.0
        refused = on[~better]
        damping[refused] *= growth[refused]
        growth[refused] *= 2
        active[on[done]] = False
        active[refused[damping[refused] > 1e10]] = False
    minima: list[RotationMinimum] = []
    for trial in np.argsort(cost):
        rms = float(np.sqrt(max(cost[trial], 0.0) / weights.sum()))
        if not minima or rms > minima[-1].rms * (1 + DISTINCT) + 1e-9:
            minima.append(RotationMinimum(axes[trial], home[trial], rms))
    return minima


def fit_rotations_robustly(
    joints: np.ndarray, rotations: np.ndarray, rng: np.random.Generator, starts: int = 24
) -> list[RotationMinimum]:
    """As :func:`fit_rotations`, with samples of mistaken pose (depth reversals, swapped labels) losing their weight.

    Each distinct minimum is taken up again with Cauchy weights of its own errors; its ``rms`` is then the median one.
    """
    minima = fit_rotations(joints, rotations, rng, starts=starts)
    refined = []
    for minimum in minima[:REFINED_MINIMA]:
        axes, home = minimum.axes, minimum.home
        errors = rotation_errors(joints, rotations, axes, home)
        for _ in range(3):
            scale = 2.0 * np.median(errors) + 1e-6
            weights = 1 / (1 + (errors / scale) ** 2) ** 2
            again = fit_rotations(joints, rotations, rng, weights, starts=0, max_iterations=30, given=[(axes, home)])[0]
            axes, home = again.axes, again.home
            errors = rotation_errors(joints, rotations, axes, home)
        refined.append(RotationMinimum(axes, home, float(np.median(errors))))
    return sorted(refined, key=lambda minimum: minimum.rms)


def rotation_errors(joints: np.ndarray, rotations: np.ndarray, axes: np.ndarray, home: np.ndarray) -> np.ndarray:
    """Angles ``(T,)`` [rad] between the chain's and the measured rotations."""
    modeled = np.broadcast_to(np.eye(3), rotations.shape)
    for axis, angle in zip(axes, joints.T, strict=True):
        modeled = modeled @ rotation_matrices(angle[:, None] * axis)
    return np.linalg.norm(rotation_vectors(rotations @ (modeled @ home).swapaxes(1, 2)), axis=1)


def _equations(
    chain: RotationChain, axes: np.ndarray, across: np.ndarray, home: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half squared Frobenius distances (k,), descent directions (k, u) and Gauss-Newton matrices (k, u, u).

    Half the squared distance of two rotations is the square of a small angle between them.
    """
    cost, errors, turns = chain.evaluate(axes, across, home)
    flat = turns.reshape(len(turns), -1, turns.shape[-1])
    transposed = flat.transpose(0, 2, 1)
    return cost, (transposed @ errors.reshape(len(turns), -1, 1))[..., 0], transposed @ flat


def _move(axes: np.ndarray, across: np.ndarray, home: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = axes.shape[1]
    turns = np.einsum("rnk,rnki->rni", step[:, : 2 * count].reshape(len(step), count, 2), across)
    moved = np.einsum("rnij,rnj->rni", rotation_matrices(turns), axes)
    moved /= np.linalg.norm(moved, axis=2, keepdims=True)
    return moved, rotation_matrices(step[:, 2 * count :]) @ home


def _starts(
    joints: np.ndarray, rotations: np.ndarray, rng: np.random.Generator, starts: int
) -> tuple[np.ndarray, np.ndarray]:
    """Trial axes (starts, n, 3) and home rotations: a third from regression of rotation vectors, the others random."""
    count = joints.shape[1]
    mean = Rotation.from_matrix(rotations).mean().as_matrix()
    vectors = rotation_vectors(rotations @ mean.T)
    design = np.hstack([joints, np.ones((len(joints), 1))])
    regressed = np.linalg.lstsq(design, vectors, rcond=1e-6)[0][:count]
    lengths = np.linalg.norm(regressed, axis=1, keepdims=True)
    regressed = np.where(lengths > 1e-6, regressed / np.maximum(lengths, 1e-6), [[0.0, 0.0, 1.0]])
    axes = rng.normal(size=(starts, count, 3))
    for trial in range((starts + 2) // 3):
        axes[trial] = regressed + rng.normal(0, 0.25 * trial, (count, 3))
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    return axes, np.repeat(mean[None], starts, axis=0)
