"""What a reach came to: how it ended, how far off, and what was wrong on the way."""

from dataclasses import dataclass
from enum import Enum

from dense_vs.health.faults import Fault


class ReachEnd(Enum):
    """How a reach ended."""

    PENDING = "pending"
    """Not over yet; only in a batch that is still running."""
    REACHED = "reached"
    """The point stayed within the tolerance of its target."""
    MISSED = "missed"
    """The frames were used up."""
    LOST = "lost"
    """It is not known where the point is."""


@dataclass(frozen=True)
class Reach:
    """One reach.

    Attributes:
        target: x, y [px].
        frames: frames it took.
        error_px: distance of the tracked point from the target at the end.
        end: how it ended.
        faults: what was wrong with its frames, each kind as it was seen last.
    """

    target: tuple[float, float]
    frames: int
    error_px: float
    end: ReachEnd
    faults: tuple[Fault, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether the point stayed within the tolerance."""
        return self.end is ReachEnd.REACHED

    @property
    def lost(self) -> bool:
        """Whether it was not known at the end where the point is."""
        return self.end is ReachEnd.LOST
