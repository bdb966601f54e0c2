"""Scores of servo runs, and which of several laws is the strongest."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.gothoskar.servo_runs import REACHED_PX, moves_needed


@dataclass(frozen=True)
class ServoScore:
    """How runs of one law went.

    Attributes:
        tasks: how many runs.
        moves: until the true error first is below 1 px, median; infinite where more than half never are.
        end_px: true error after the last move, median [px].
        over: share of the runs that do not end below 1 px.
    """

    tasks: int
    moves: float
    end_px: float
    over: float


def score(errors: np.ndarray) -> ServoScore:
    """The score of true errors (B, moves + 1) [px].

    Raises:
        DenseVSError: no run, or none with a start.
    """
    _check(errors)
    ends_below = errors[:, -1] < REACHED_PX  # an error that is no number is not below
    return ServoScore(
        len(errors),
        float(np.median(moves_needed(errors))),
        float(np.median(errors[:, -1])),
        float(1 - ends_below.mean()),
    )


def cost(errors: np.ndarray) -> float:
    """Mean moves to below 1 px of runs (B, moves + 1) [px]; one that does not end there counts with all of them."""
    _check(errors)
    needed = np.where(errors[:, -1] < REACHED_PX, moves_needed(errors), errors.shape[1] - 1)
    return float(needed.mean())


def strongest(tables: Mapping[str, np.ndarray]) -> str:
    """The name with the least cost; of equal ones that with the least error at the end, median.

    Raises:
        DenseVSError: nothing to choose from.
    """
    if not tables:
        raise DenseVSError("no law was tried; expected at least one")
    return min(tables, key=lambda name: (cost(tables[name]), float(np.median(tables[name][:, -1]))))


def _check(errors: np.ndarray) -> None:
    if errors.ndim != 2 or errors.shape[0] < 1 or errors.shape[1] < 2:
        raise DenseVSError(f"errors have shape {errors.shape}; expected (runs, moves + 1) with at least one of each")
