"""Timing of alternatives in one run: a round runs each of them in turn, so that what disturbs one disturbs all.

Medians over rounds are compared, and a ratio is the median of the rounds' ratios, not the ratio of medians.
"""

import time
from collections.abc import Callable, Mapping

import numpy as np


def interleaved(
    alternatives: Mapping[str, Callable[[int], object]], rounds: int, warmup: int = 3, calls: int = 1
) -> dict[str, np.ndarray]:
    """Seconds of each alternative in each round, shape ``(rounds,)`` by name.

    Args:
        alternatives: functions of the round's number, by name.
        rounds: rounds that are timed.
        warmup: rounds before them that are not.
        calls: calls of each in a round. With several, the first is left out and the median of the others counts: it
            fills the caches that the alternatives before it emptied, as no loop over frames would.
    """
    seconds = {name: np.empty(rounds) for name in alternatives}
    names, rng = list(alternatives), np.random.default_rng(0)
    for round_number in range(-warmup, rounds):
        # By chance: nobody always follows the same one, whose data fill the cache and whose threads may still spin.
        for name in rng.permutation(names).tolist():
            elapsed = []
            for call in range(calls):
                start = time.perf_counter()
                alternatives[name]((round_number + warmup) * calls + call)
                elapsed.append(time.perf_counter() - start)
            if round_number >= 0:
                seconds[name][round_number] = np.median(elapsed[1:] if calls > 1 else elapsed)
    return seconds


def median_ratio(theirs: np.ndarray, ours: np.ndarray) -> float:
    """Median of the rounds' ratios theirs / ours."""
    return float(np.median(theirs / ours))
