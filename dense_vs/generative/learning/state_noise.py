"""Stage 4: states that are not exact, with their noise estimated from the data.

Gothoskar (11) is the minimum of Gothoskar (10), over noisy readings; Gothoskar (15) that of Gothoskar (14), over
actions.

The paper picks lambda on a validation set. It is the ratio of two variances, so here both are estimated: that of the
pixels from the bundle adjustment, which uses no joints, and that of the joints by expectation maximization between
solutions, sigma^2 = mean(deviation^2 + posterior variance).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dense_vs.generative.kinematics.denavit_hartenberg import DHProblem
from dense_vs.generative.least_squares.joint_priors import JointActions, JointReadings
from dense_vs.generative.least_squares.levenberg_marquardt import Solution, minimize
from dense_vs.generative.least_squares.pixel_problem import PixelProblem, PixelState

ROUNDS = 12
SETTLED = 0.02  # relative change of sigma
FIRST_SIGMA = 0.02  # rad


def fit_noisy_readings(
    problem: PixelProblem | DHProblem,
    state: PixelState,
    joints: np.ndarray,
    pixel_sigma: float,
    joint_sigma: float | None,
) -> tuple[Solution, float]:
    """Gothoskar (11): joints of the samples and all shared parameters from readings ``(T, n)``; also sigma [rad]."""

    def prior(sigma: float) -> JointReadings:
        return JointReadings(joints, (pixel_sigma / sigma) ** 2)

    def deviation(solved: PixelState) -> np.ndarray:
        return solved.joints - joints

    return _fit(problem, state, prior, deviation, pixel_sigma, joint_sigma, np.ones(joints.shape), chained=False)


def fit_noisy_actions(
    problem: PixelProblem | DHProblem,
    state: PixelState,
    actions: np.ndarray,
    pixel_sigma: float,
    action_sigma: float | None,
    proportional: bool = False,
) -> tuple[Solution, float]:
    """As :func:`fit_noisy_readings` from actions ``(T - 1, n)``, Gothoskar (15).

    With ``proportional`` sigma is a share of the commanded step, beside a hundredth of the usual step.
    """
    usual = float(np.sqrt(np.mean(actions**2)))
    spread = np.sqrt(actions**2 + (0.01 * usual) ** 2) if proportional else np.ones(actions.shape)

    def prior(sigma: float) -> JointActions:
        return JointActions(actions, (pixel_sigma / (sigma * spread)) ** 2)

    def deviation(solved: PixelState) -> np.ndarray:
        return np.diff(solved.joints, axis=0) - actions

    return _fit(problem, state, prior, deviation, pixel_sigma, action_sigma, spread, chained=True)


def _fit(
    problem: PixelProblem | DHProblem,
    state: PixelState,
    prior: Callable[[float], JointReadings | JointActions],
    deviation: Callable[[PixelState], np.ndarray],
    pixel_sigma: float,
    given: float | None,
    spread: np.ndarray,
    chained: bool,
) -> tuple[Solution, float]:
    sigma = FIRST_SIGMA / float(np.sqrt(np.mean(spread**2))) if given is None else given
    solution, iterations, seconds = None, 0, 0.0
    for _ in range(1 if given is not None else ROUNDS):
        (problem.problem if isinstance(problem, DHProblem) else problem).prior = prior(sigma)
        solution = minimize(problem, state, max_iterations=40, tolerance=1e-6)
        state = solution.state
        iterations, seconds = iterations + solution.iterations, seconds + solution.seconds
        if given is not None:
            break
        variance = _posterior_variance(problem, state, pixel_sigma, chained)
        again = float(np.sqrt(np.mean((deviation(state) ** 2 + variance) / spread**2)))
        settled = abs(again - sigma) < SETTLED * sigma
        sigma = max(again, 1e-5)
        if settled:
            break
    assert solution is not None
    return replace(solution, iterations=iterations, seconds=seconds), sigma


def _posterior_variance(problem: Any, state: PixelState, pixel_sigma: float, chained: bool) -> np.ndarray:
    """Variance [rad^2] of each deviation given the shared parameters."""
    equations = problem.linearize(state)
    assert equations.local is not None
    if not chained:
        inverse = np.linalg.inv(equations.local)
        return pixel_sigma**2 * np.einsum("tii->ti", inverse)
    assert equations.chained is not None
    own, across = neighbor_covariance(equations.local, equations.chained)
    variance = np.einsum("tii->ti", own)
    return pixel_sigma**2 * (variance[1:] + variance[:-1] - 2 * np.einsum("tii->ti", across))


def neighbor_covariance(local: np.ndarray, chained: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Blocks of the inverse of a block-tridiagonal matrix: the diagonal, and those below it."""
    inverse = [np.linalg.inv(local[0])]
    for block, below in zip(local[1:], chained, strict=True):
        inverse.append(np.linalg.inv(block - below @ inverse[-1] @ below.T))
    own, across = [inverse[-1]], []
    for forward, below in zip(inverse[-2::-1], chained[::-1], strict=True):
        gain = below @ forward
        across.append(-own[-1] @ gain)
        own.append(forward + gain.T @ own[-1] @ gain)
    return np.array(own[::-1]), np.array(across[::-1])
