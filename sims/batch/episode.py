"""What each robot of a batch goes through, and what came of it."""

from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError

OUTCOMES = ("pending", "reached", "missed", "lost")  # by the numbers of kernels/servo_episode.py


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """What a world goes through.

    Attributes:
        babble_seconds: time spent learning J first [s].
        tolerance: distance of the tracked point from its target that counts as there [px].
        settle_frames: frames it has to stay there.
        max_frames: frames after which a reach is given up.
    """

    babble_seconds: float = 10.0
    tolerance: float = 1.0
    settle_frames: int = 5
    max_frames: int = 150

    def __post_init__(self):
        for name in ("babble_seconds", "tolerance"):
            value = getattr(self, name)
            number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or value <= 0:
                raise DenseVSError(f"{name} is {value!r}; expected a finite number above 0")
        for name in ("settle_frames", "max_frames"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
                raise DenseVSError(f"{name} is {value!r}; expected a whole number of at least 1")


@dataclass(frozen=True)
class BatchResults:
    """What came of the reaches of B worlds with K targets each, by the loop and by the simulator's truth.

    Attributes:
        outcome: (B, K) of ``"pending"``, ``"reached"``, ``"missed"`` (given up) and ``"lost"`` (its point).
        frames: (B, K), that the reach took.
        error_px: (B, K), tracked point to target at the end [px]; NaN while pending.
        true_error_px: (B, K), the point itself to target [px].
        restarts: (B,), how often a world was put back to its beginning because its state was not finite.
    """

    outcome: np.ndarray
    frames: np.ndarray
    error_px: np.ndarray
    true_error_px: np.ndarray
    restarts: np.ndarray
