"""When a point has arrived at its target, and what a reach came to: its end, its error, what was wrong on the way."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

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


CLOSE = 0.3  # of the tolerance


class Arrival:
    """Counts the frames that a point has been at its target; reached where that is settled and the place is certain.

    Args:
        tolerance: distance that counts as there [px].
        frames: that it has to be there, one after the other.
        leave: distance up to which it stays there once it has settled [px]; the tolerance unless given.

    Attributes:
        tolerance: as given.
    """

    def __init__(self, tolerance: float, frames: int, leave: float | None = None):
        self.tolerance, self._frames = tolerance, frames
        self._leave = tolerance if leave is None else leave
        self._there, self._distance = 0, np.inf

    def observe(self, distance: float, *, blind: bool = False) -> None:
        """Take a frame.

        Args:
            distance: from the target [px].
            blind: whether something is wrong with the frame that stops the robot.
        """
        within = distance <= (self._leave if self.settled else self.tolerance)
        self._there, self._distance = self._there + 1 if within and not blind else 0, distance

    @property
    def settled(self) -> bool:
        """Whether it has been there long enough."""
        return self._there >= self._frames

    @property
    def close(self) -> bool:
        """Whether hardly anything is left of the way by the last frame."""
        return self._distance <= CLOSE * self.tolerance


@dataclass(frozen=True)
class Reach:
    """One reach.

    Attributes:
        target: x, y [px], and depth [m] where it had one.
        frames: frames it took.
        error_px: distance of the tracked point from the target at the end; a meter of depth counts as one across the
            image there.
        end: how it ended.
        faults: what was wrong with its frames, each kind as it was seen last.
        uncertainty_px: standard deviation of the point's place, the median of its last images, infinite where it is not
            known at all; above 0.8 of the tolerance, or of 1 px, the reach ends as lost. None where nothing tells it.
    """

    target: tuple[float, ...]
    frames: int
    error_px: float
    end: ReachEnd
    faults: tuple[Fault, ...] = ()
    uncertainty_px: float | None = None

    @property
    def reached(self) -> bool:
        """Whether the point stayed within the tolerance."""
        return self.end is ReachEnd.REACHED

    @property
    def lost(self) -> bool:
        """Whether it was not known at the end where the point is."""
        return self.end is ReachEnd.LOST
