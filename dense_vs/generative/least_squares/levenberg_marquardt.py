"""Levenberg-Marquardt with the samples' own unknowns eliminated by the Schur complement.

Beyond the paper, which uses L-BFGS: damping by the diagonal of the normal matrix (Marquardt), its factor by Nielsen's
rule (Damping parameter in Marquardt's method, 1999, eq. 2.4). The diagonal makes the step independent of units, and the
damping holds what images leave open, as the scale.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solveh_banded
from scipy.linalg.lapack import dposv

from dense_vs.device import one_blas_thread
from dense_vs.generative.least_squares.pixel_problem import NormalEquations, PixelProblem, PixelState

GRADIENT_SCALE_FLOOR = 1e-12  # of the largest diagonal: columns below stand still


@dataclass
class Solution:
    """Where a solver stopped.

    Attributes:
        state: the best state.
        cost: sum of squares there [px^2].
        initial_cost: at the start.
        iterations: steps tried.
        converged: whether the cost had stopped to fall, rather than the iterations run out.
        seconds: wall time.
    """

    state: PixelState
    cost: float
    initial_cost: float
    iterations: int
    converged: bool
    seconds: float


def minimize(
    problem: PixelProblem | Any,
    state: PixelState,
    max_iterations: int = 60,
    tolerance: float = 1e-7,
    damping: float = 1e-3,
) -> Solution:
    """Minimize ``problem.cost`` from ``state``.

    Args:
        problem: has ``linearize``, ``cost`` and ``move`` as :class:`PixelProblem`.
        state: where to start.
        max_iterations: steps tried at most.
        tolerance: stop when a step was to lower the cost by less than this share of it.
        damping: first factor on the diagonal.
    """
    with one_blas_thread():
        return _minimize(problem, state, max_iterations, tolerance, damping)


def _minimize(problem: Any, state: PixelState, max_iterations: int, tolerance: float, damping: float) -> Solution:
    started = time.perf_counter()
    equations = problem.linearize(state)
    initial = equations.cost
    if not np.isfinite(initial):
        return Solution(state, np.inf, np.inf, 0, False, time.perf_counter() - started)
    growth, converged, iteration = 2.0, False, 0
    while iteration < max_iterations and not converged:
        iteration += 1
        step = _step(equations, damping)
        if step is None:
            damping, growth = damping * growth, growth * 2
            continue
        shared, local, predicted = step
        candidate = problem.move(state, shared, local)
        cost = problem.cost(candidate)
        if predicted <= tolerance * equations.cost:
            converged = True
            if cost < equations.cost:
                state, equations.cost = candidate, cost
            break
        gain = (equations.cost - cost) / predicted
        if gain > 0:
            state = candidate
            if iteration == max_iterations:  # no step follows that would need its equations
                equations.cost = cost
                break
            equations = problem.linearize(state)
            damping *= max(1 / 3, 1 - (2 * gain - 1) ** 3)
            growth = 2.0
        else:
            damping, growth = damping * growth, growth * 2
            if damping > 1e14:
                break
    return Solution(state, equations.cost, initial, iteration, converged, time.perf_counter() - started)


def _step(equations: NormalEquations, damping: float) -> tuple[np.ndarray, np.ndarray | None, float] | None:
    """Step of shared and local unknowns, and by how much the cost should fall; None if the matrix is not definite."""
    scale = _scale(equations.shared.diagonal())
    matrix = equations.shared.copy()
    matrix[np.diag_indices_from(matrix)] += damping * scale
    gradient = equations.shared_gradient
    if equations.local is None:
        shared = _solve(matrix, -gradient)
        if shared is None:
            return None
        predicted = shared @ (damping * scale * shared - gradient)
        return shared, None, float(predicted)
    width = equations.local.shape[1]
    local_scale = _scale(np.einsum("tii->ti", equations.local))
    blocks = equations.local.copy()
    blocks[:, np.arange(width), np.arange(width)] += damping * local_scale
    assert equations.coupling is not None
    assert equations.local_gradient is not None
    right = np.concatenate([equations.coupling, equations.local_gradient[..., None]], axis=2)
    solved = _solve_blocks(blocks, equations.chained, right)
    if solved is None:
        return None
    # Sample by sample: products this small are not worth a BLAS library's threads.
    reduced = (equations.coupling.swapaxes(1, 2) @ solved).sum(axis=0)
    shared = np.zeros(0)
    if len(gradient):
        shared = _solve(matrix - reduced[:, :-1], reduced[:, -1] - gradient)
        if shared is None:
            return None
    local = -solved[..., -1] - solved[..., :-1] @ shared
    predicted = shared @ (damping * scale * shared - gradient)
    predicted += (local * (damping * local_scale * local - equations.local_gradient)).sum()
    return shared, local, float(predicted)


def _scale(diagonal: np.ndarray) -> np.ndarray:
    """The diagonal, with ones where an unknown has no influence."""
    floor = GRADIENT_SCALE_FLOOR * diagonal.max(initial=0.0)
    return np.where(diagonal > floor, diagonal, max(floor, 1.0))


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    _, solution, info = dposv(matrix, right)
    return solution if info == 0 and np.isfinite(solution).all() else None


def _solve_blocks(blocks: np.ndarray, chained: np.ndarray | None, right: np.ndarray) -> np.ndarray | None:
    """Solve the samples' part, block-diagonal or block-tridiagonal."""
    if chained is None:
        try:
            return np.linalg.solve(blocks, right)
        except np.linalg.LinAlgError:
            return None
    samples, width = blocks.shape[:2]
    band = np.zeros((2 * width, samples * width))  # lower form: band[i - j, j] = a[i, j]
    for row in range(width):
        for column in range(width):
            if row >= column:
                band[row - column, column::width] = blocks[:, row, column]
            band[width + row - column, column : (samples - 1) * width : width] = chained[:, row, column]
    try:
        solved = solveh_banded(band, right.reshape(samples * width, -1), lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    return solved.reshape(right.shape)
