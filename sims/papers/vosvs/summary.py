"""Summaries of measured values of which some may be missing."""

from collections.abc import Iterable

import numpy as np


def finite_percentile(values: Iterable[float], percent: float = 50.0) -> float:
    """A percentile, the median unless told, of the values that are finite; nan where none is."""
    kept = np.array([value for value in values if np.isfinite(value)], dtype=float)
    return float(np.percentile(kept, percent)) if kept.size else float("nan")
