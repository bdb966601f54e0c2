"""Levenberg-Marquardt of the generative model, for states of this room: points in place of samples are eliminated."""

from typing import Any, TypeVar

from dense_vs.generative.least_squares.levenberg_marquardt import minimize

S = TypeVar("S")


def solve(problem: Any, state: S, iterations: int, tolerance: float) -> tuple[S, float]:
    """The best state and its cost, see :func:`minimize`; ``problem`` has ``linearize``, ``cost`` and ``move``."""
    start: Any = state
    solution = minimize(problem, start, iterations, tolerance=tolerance)
    found: Any = solution.state
    return found, solution.cost
