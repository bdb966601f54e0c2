"""Detections that a model explains only as mistakes, and pairs whose labels look exchanged."""

import numpy as np

from dense_vs.generative.report import Outlier

SIGMAS = 6.0  # of a coordinate: a Rayleigh error beyond has a chance of 2e-8
FLOOR_PX = 2.0


def mistaken(errors: np.ndarray, sigma: float) -> np.ndarray:
    """Mask ``(T, c, m)`` of errors [px] that noise of ``sigma`` px a coordinate does not make; NaN counts as sound."""
    return np.nan_to_num(errors) > max(SIGMAS * sigma, FLOOR_PX)


def robust_sigma(errors: np.ndarray) -> float:
    """Noise of a coordinate [px] from the median of Rayleigh-distributed distances; NaN is left out."""
    known = errors[np.isfinite(errors)]
    return float(np.median(known) / 1.1774) if len(known) else float("nan")


def list_outliers(
    pixels: np.ndarray, modelled: np.ndarray, mask: np.ndarray, sigma: float
) -> tuple[list[Outlier], list[tuple[int, int, int, int]]]:
    """Outliers of the mask and, among them, pairs of one image that fit when exchanged.

    Args:
        pixels, modelled: ``(T, c, m, 2)``.
        mask: ``(T, c, m)``.
        sigma: noise of a coordinate [px].
    """
    limit = max(SIGMAS * sigma, FLOOR_PX)
    outliers, swapped = [], []
    for t, c, m in np.argwhere(mask):
        error = float(np.linalg.norm(pixels[t, c, m] - modelled[t, c, m]))
        outliers.append(Outlier(int(t), int(c), int(m), error))
        for other in np.flatnonzero(mask[t, c]):
            crossed = [(m, other), (other, m)]
            if other > m and all(np.linalg.norm(pixels[t, c, a] - modelled[t, c, b]) < limit for a, b in crossed):
                swapped.append((int(t), int(c), int(m), int(other)))
    return outliers, swapped
