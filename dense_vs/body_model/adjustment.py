"""Bundle adjustment of lines, camera and points on given links, with weights against gross errors."""

import numpy as np

from dense_vs.body_model.solver import solve
from dense_vs.body_model.track_problem import BodyState, TrackProblem

_GROSS = 3.0  # times the usual error: weights fall beyond


def adjust(
    state: BodyState,
    joints: np.ndarray,
    pixels: np.ndarray,
    links: np.ndarray,
    center: tuple[float, float],
    focal_prior: tuple[float, float],
    noise: float,
    rounds: int,
    iterations: int,
    bend_deviation: float = 0.0,
    directions: np.ndarray | None = None,
    information: np.ndarray | None = None,
) -> tuple[BodyState, float, float]:
    """Bundle adjustment with weights that fall with the error, found anew in every round.

    The arguments are those of :class:`.TrackProblem`, and rounds of so many iterations each.

    Returns:
        The state, its mean robust error (0 to 1) and its median error [px].
    """
    problem = TrackProblem(
        joints, pixels, links, center, np.ones(pixels.shape[:2]), focal_prior, noise, bend_deviation, directions,
        information,
    )  # fmt: skip
    state = adjusted(problem, state, rounds, iterations)
    squared = _squared(problem, state)
    robust = float(np.mean(squared / (squared + (_GROSS * noise) ** 2)))
    return state, robust, float(np.median(np.sqrt(squared)))


def adjusted(problem: TrackProblem, state: BodyState, rounds: int, iterations: int) -> BodyState:
    """The state of :func:`adjust`, where its errors are not asked for.

    Args:
        problem: its observations have equal weights, which are found here.
        state: where to start.
        rounds, iterations: as in :func:`adjust`.
    """
    for _ in range(rounds):
        squared = _squared(problem, state)
        scale = max(problem.noise, float(np.median(np.sqrt(squared))) / 1.1774)
        weights = 1 / (1 + squared / (_GROSS * scale) ** 2) ** 2
        state, _ = solve(problem.weighted(weights), state, iterations, 1e-4)
    return state


def _squared(problem: TrackProblem, state: BodyState) -> np.ndarray:
    """Squares of the distances ``(O,)`` [px^2], bounded."""
    return np.minimum((problem.errors(state) ** 2).sum(axis=1), 1e12)
