"""How a point was seen when it was defined, by which it is found again after it was lost."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dense_vs.point_servo.tracker import PointTracker


@dataclass(frozen=True)
class PointMemory:
    """A point in the image that it was defined in: before a camera that stands still, that posture shows it there.

    Attributes:
        place: ``(2,)`` [px].
        positions: joint positions ``(N,)`` [rad].
        gray: uint8 ``(H, W)``.
        weights: of the pixels that move as the point does, see :class:`PointTracker`.
        options: of its tracker.
        by_link: whether it is to be followed by its link, where the body that it is on is known.
    """

    place: np.ndarray
    positions: np.ndarray
    gray: np.ndarray
    weights: np.ndarray | None
    options: dict[str, Any] = field(default_factory=dict)
    by_link: bool = False

    def tracker(self) -> PointTracker:
        """A tracker that begins in that image."""
        return PointTracker(self.place, self.gray, weights=self.weights, **self.options)

    def seen_in(self, gray: np.ndarray) -> PointTracker | None:
        """A tracker that has found the point in an image from the same posture; None where it looks otherwise."""
        tracker = self.tracker()
        tracker.update(np.zeros((*gray.shape, 2), np.float32), gray)
        return tracker if float(tracker.correlation[0]) >= tracker.options.min_correlation else None
