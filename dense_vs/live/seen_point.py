"""Where the body's process has seen a point, as it tells the loop."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SeenPoint:
    """Where a point was seen by its body.

    Attributes:
        place: ``(2,)`` [px].
        certain, lost: as of :class:`BodyTracker`.
        uncertainty: standard deviation of the place [px].
    """

    place: np.ndarray
    certain: bool
    lost: bool
    uncertainty: float
