"""When the images of a recording were taken, and where the joints were then.

A recorder stamps an image when it writes it. A camera takes images at even intervals; what the recorder adds is jitter
of up to one of its own periods, so that two images follow each other in one period and the next after three. Their
joint steps are then off by half. :func:`even_stamps` brings the camera's own rhythm back, :func:`smoothed` takes the
log's jitter out of the joints.
"""

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.errors import DenseVSError

NEIGHBORS = 20  # images to either side that a stamp is fitted with: two to three seconds, shorter than clocks drift in
LEFT_OUT = 1.5  # image intervals: a longer gap is one of missing images, not jitter


def even_stamps(times: np.ndarray) -> np.ndarray:
    """Stamps of distinct images, evened out by a straight line through those around each.

    Args:
        times: ``(T,)`` [s], increasing, at least 2, without repeated images.

    Returns:
        float64 ``(T,)`` [s], increasing. Where images are missing the line begins anew.

    Raises:
        DenseVSError: another shape, or times that do not increase.
    """
    stamps = real_vector(times, "times", (-1,))
    if len(stamps) < 2 or (np.diff(stamps) <= 0).any():
        raise DenseVSError(f"times are {len(stamps)} that do not increase throughout; expected at least 2 that do")
    steps = np.diff(stamps)
    # Jitter makes a step long and the one before or after it short; a gap has no such neighbor.
    around = np.convolve(np.pad(steps, 1, mode="edge"), np.full(3, 1 / 3), mode="valid")
    cuts = np.flatnonzero((steps > LEFT_OUT * np.median(steps)) & (around > LEFT_OUT * np.median(steps))) + 1
    even = np.concatenate([_line(piece) for piece in np.split(stamps, cuts)])
    return np.maximum.accumulate(even + 1e-9 * np.arange(len(even)))


def smoothed(positions: np.ndarray, width: float) -> np.ndarray:
    """Joint positions ``(T, N)`` smoothed over time by a Gaussian of ``width`` rows; the ends are held."""
    radius = int(np.ceil(4 * width))
    if radius == 0:
        return np.array(positions, dtype=np.float64)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / width) ** 2)
    padded = np.pad(np.asarray(positions, dtype=np.float64), ((radius, radius), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, weights / weights.sum(), mode="valid") for column in padded.T], axis=1)


def _line(stamps: np.ndarray) -> np.ndarray:
    even = np.array(stamps)
    for k in range(len(stamps)):
        first, last = max(0, k - NEIGHBORS), min(len(stamps), k + NEIGHBORS + 1)
        if last - first > 2:
            _, level = np.polyfit(np.arange(first, last) - k, stamps[first:last] - stamps[k], 1)
            even[k] = stamps[k] + level
    return even
