"""Whether a figure of a long run grows, as memory does that leaks: by its slope once the run has settled."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

SETTLED = 1 / 3  # of the run, which may still fill its buffers and caches
LEAST = 6  # samples after that
NOISE = 3.0  # times the scatter about the line, that a rise has to exceed


@dataclass(frozen=True)
class Growth:
    """What one figure did.

    Attributes:
        level: its median once settled.
        rise: by its line, from where it had settled to the end, in its unit.
        scatter: median distance from that line, in its unit.
        grows: whether the rise is more than scatter and allowance explain.
    """

    level: float
    rise: float
    scatter: float
    grows: bool


def growth(minutes: Sequence[float], values: Sequence[float], allowed: float) -> Growth:
    """Judge samples of one figure.

    The line is Theil and Sen's, the median of all pairs' slopes: a single peak does not tilt it.

    Args:
        minutes: when each was taken.
        values: of the figure.
        allowed: rise over the judged time that is no growth, in the figure's unit.

    Raises:
        ValueError: too few samples to judge by, or values that are not finite.
    """
    time, value = np.asarray(minutes, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if not np.isfinite(value).all() or not np.isfinite(time).all():
        raise ValueError("samples are not finite")
    judged = time >= time.min() + SETTLED * np.ptp(time)
    time, value = time[judged], value[judged]
    if len(time) < LEAST:
        raise ValueError(f"{len(time)} samples after the first third; expected at least {LEAST}")
    pairs = [(a, b) for a, b in combinations(range(len(time)), 2) if time[b] > time[a]]
    slope = float(np.median([(value[b] - value[a]) / (time[b] - time[a]) for a, b in pairs]))
    off = value - slope * time
    scatter = float(np.median(np.abs(off - np.median(off))))
    rise = slope * float(np.ptp(time))
    return Growth(float(np.median(value)), rise, scatter, rise > max(allowed, NOISE * scatter / np.sqrt(len(time))))
