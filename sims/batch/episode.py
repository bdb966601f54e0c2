"""Options of the course that each robot of a batch takes, and its results."""

from dataclasses import dataclass

import numpy as np

from dense_vs.checks import check_number, check_whole
from dense_vs.point_servo.reach import ReachEnd

# By the numbers of kernels/simulation/servo_episode.py.
ENDS = (ReachEnd.PENDING, ReachEnd.REACHED, ReachEnd.MISSED, ReachEnd.LOST)


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """The course of a world: babbling, then one reach after another.

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
            check_number(name, getattr(self, name), above=0)
        for name in ("settle_frames", "max_frames"):
            check_whole(name, getattr(self, name), least=1)


@dataclass(frozen=True)
class BatchResults:
    """Reaches of B worlds with K targets each, as the loop and as the simulator's truth have them.

    Attributes:
        outcome: (B, K) of :class:`dense_vs.point_servo.ReachEnd`. A world that loses its point stops; its remaining
            targets are ``LOST``, too.
        frames: (B, K), that the reach took; 0 where it never began.
        error_px: (B, K), tracked point to target at the end [px]; NaN while pending and where it never began.
        true_error_px: (B, K), the point itself to target [px], likewise.
        restarts: (B,), how often a world was put back to its beginning because its state was not finite.
    """

    outcome: np.ndarray
    frames: np.ndarray
    error_px: np.ndarray
    true_error_px: np.ndarray
    restarts: np.ndarray

    def summary(self) -> dict[str, float]:
        """Shares of all reaches, their errors where they ended [px], and how many worlds began anew."""
        true = self.true_error_px[np.isfinite(self.true_error_px)]
        shares = {end.value: float(np.mean(self.outcome == end)) for end in ENDS}
        return {
            "worlds": len(self.outcome),
            "reaches": self.outcome.size,
            **{f"share {name}": share for name, share in shares.items()},
            "true error, median [px]": float(np.median(true)) if true.size else float("nan"),
            "true error, 95th percentile [px]": float(np.percentile(true, 95)) if true.size else float("nan"),
            "worlds that began anew": int(np.count_nonzero(self.restarts)),
        }
