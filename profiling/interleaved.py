"""Timing of alternatives in one run: a round runs each of them once, so that what disturbs one disturbs all.

Medians over rounds are compared, and a ratio is the median of the rounds' ratios, not the ratio of medians.
"""

import time
from collections.abc import Callable, Mapping

import numpy as np


def interleaved(
    alternatives: Mapping[str, Callable[[int], object]], rounds: int, warmup: int = 3
) -> dict[str, np.ndarray]:
    """Seconds of each alternative in each round, shape ``(rounds,)`` by name.

    Args:
        alternatives: functions of the round's number, by name.
        rounds: rounds that are timed.
        warmup: rounds before them that are not.
    """
    seconds = {name: np.empty(rounds) for name in alternatives}
    order = list(alternatives)
    for round_number in range(-warmup, rounds):
        order = order[1:] + order[:1]  # nobody always follows the same one, whose data fill the cache
        for name in order:
            start = time.perf_counter()
            alternatives[name](round_number + warmup)
            elapsed = time.perf_counter() - start
            if round_number >= 0:
                seconds[name][round_number] = elapsed
    return seconds


def median_ratio(theirs: np.ndarray, ours: np.ndarray) -> float:
    """Median of the rounds' ratios theirs / ours."""
    return float(np.median(theirs / ours))
