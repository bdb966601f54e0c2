"""Where an object is looked for in the next image, and when that is not enough; beyond VOS-VS, which looks everywhere.

A camera that takes 30 images a second sees an object nearly where it was: its region is looked for in a window around
the last mask, a fifth of the work. What is found there is doubted where it may be a part of the object or something
else: the whole image is then looked at, in the same frame.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from dense_vs.segmentation.few_shot.candidate_regions import CELL

LEAST_WINDOW = 16  # px of the reduced image
LEAST_SCORE = 0.75  # of the track's, below which a score has fallen
MOST_GROWTH = 1.3  # of the object's length and breadth, the root of its area, from image to image
AREA_SLACK = 2.0  # px more of that root: a small object's outline errs by as much
NEW_SCORE = 0.2  # weight of an image in the track's score


class Doubt(Enum):
    """Why the whole image was looked at although the object had been found in the image before."""

    MISSED = "nothing in the window is the object"
    CUT = "the region reaches the window's edge and may go on outside"
    FAINT = "its score fell"
    RESIZED = "its area changed more than a camera's motion explains"
    OTHER_SIZE = "the image has another size than the one before"


@dataclass(frozen=True)
class FoundRegion:
    """An object's region in a reduced image.

    Attributes:
        pixels: bool (h, w), at least one set.
        score: predicted overlap with the object.
    """

    pixels: np.ndarray
    score: float

    @property
    def length(self) -> float:
        """Root of the area [px]."""
        return float(np.sqrt(np.count_nonzero(self.pixels)))


@dataclass(frozen=True)
class Window:
    """Part of an image (h, w)."""

    rows: slice
    columns: slice

    @classmethod
    def of_image(cls, shape: tuple[int, int]) -> "Window":
        """The whole of it."""
        return cls(slice(0, shape[0]), slice(0, shape[1]))

    @classmethod
    def around(cls, region: np.ndarray, margin: int) -> "Window":
        """A region's bounding box and a margin [px], within its image.

        Superpixels and the pixels that are classified lie on grids, which a window keeps: it begins at a multiple of
        both.
        """
        return cls(*(_grown(np.atleast_1d(region.any(axis=axis)), margin) for axis in (1, 0)))

    def cuts(self, region: np.ndarray) -> bool:
        """Whether a region (h, w) reaches an edge of the window that is none of the image's."""
        (height, width), rows, columns = region.shape, self.rows, self.columns
        return bool(
            (rows.start > 0 and region[rows.start].any())
            or (rows.stop < height and region[rows.stop - 1].any())
            or (columns.start > 0 and region[:, columns.start].any())
            or (columns.stop < width and region[:, columns.stop - 1].any())
        )


class ObjectTrack:
    """What is known of an object from the images before.

    Attributes:
        mask: last mask, bool ``(H, W)`` of the full image; None where the object was not found.
        region: the same in the reduced image.
        score: mean of the last scores, the newest ones counting most.
    """

    def __init__(self):
        self.forget()

    def forget(self) -> None:
        """The next image may show the object anywhere."""
        self.mask: np.ndarray | None = None
        self.region: FoundRegion | None = None
        self.score = 0.0

    def follow(self, mask: np.ndarray, region: FoundRegion, *, anew: bool) -> None:
        """Keep what was found, ``anew`` where the whole image was looked at: its score is then what to expect."""
        self.score = region.score if anew else self.score + NEW_SCORE * (region.score - self.score)
        self.mask, self.region = mask, region

    def window(self, shape: tuple[int, int], margin: int) -> Window | None:
        """Where to look first in a reduced image of this shape; None without a mask of such an image."""
        if self.region is None or self.region.pixels.shape != shape:
            return None
        return Window.around(self.region.pixels, margin)

    def doubt(self, found: FoundRegion | None, window: Window) -> Doubt | None:
        """Why a region that was found in a window may not be the object, or not all of it; None where it is."""
        if found is None or self.region is None:
            return Doubt.MISSED
        if window.cuts(found.pixels):
            return Doubt.CUT
        if found.score < LEAST_SCORE * self.score:
            return Doubt.FAINT
        small, large = sorted((found.length, self.region.length))
        return Doubt.RESIZED if large > MOST_GROWTH * small + AREA_SLACK else None


def _grown(taken: np.ndarray, margin: int) -> slice:
    """From the first to the last place taken (n,), and a margin more [px]."""
    places = np.flatnonzero(taken)
    length = len(taken)
    first = max(min(int(places[0]) - margin, length - LEAST_WINDOW), 0)
    first -= first % CELL
    return slice(first, min(max(int(places[-1]) + 1 + margin, first + LEAST_WINDOW), length))
