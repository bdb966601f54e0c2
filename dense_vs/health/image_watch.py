"""Whether an image says anything: not black, not the one before once more, and repaired where single pixels are wrong.

The tests compare with what the same camera showed before, so they know no threshold of a scene: contrast, the share of
outstanding pixels, and for a frozen image the motion that the joints must have caused.
"""

from collections.abc import Callable

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.health.faults import Fault, FaultKind
from dense_vs.robot.camera_image import check_gray

DARK = 0.2  # of the usual contrast
LEAST_CONTRAST = 1.5  # gray levels, standard deviation, where nothing is known yet
UNSEEN_MOTION = 0.5  # px that the robot must have moved in the image for the same image to be a frozen one
OUTSTANDING = 40  # gray levels between a pixel and the median of the 9 around it
MORE_OUTSTANDING = 0.005  # share of the pixels above the usual one
TRIED_AGAIN = 30  # frames after which a frozen image stops no motion once, so that one that is not frozen shows
USUAL = 0.05  # weight of the newest image in what is usual


class ImageWatch:
    """Judges gray images in their order."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget earlier images, as after a gap."""
        self._seen: np.ndarray | None = None
        self._moved = 0.0
        self._repeated = 0
        self._contrast: float | None = None
        self._outstanding: float | None = None

    def judge(self, gray: np.ndarray, moved_px: Callable[[], float]) -> tuple[np.ndarray, Fault | None]:
        """The image as it may be used, and what is wrong with it.

        Args:
            gray: uint8 ``(H, W)``.
            moved_px: says by how much the joints moved the robot in the image since the last one [px]; asked for
                where the image is the same again.

        Raises:
            DenseVSError: no such image, or ``moved_px`` cannot be called.
        """
        gray = check_gray(gray)
        if not callable(moved_px):
            raise DenseVSError(f"moved_px is a {type(moved_px).__name__}; expected what can be called")
        repeated = self._seen is not None and np.array_equal(gray, self._seen)
        self._seen = gray
        contrast = float(gray[::3, ::3].std())
        least = LEAST_CONTRAST if self._contrast is None else DARK * self._contrast
        if contrast < least:
            return gray, Fault(FaultKind.DARK, f"contrast {contrast:.1f} gray levels; at least {least:.1f} is expected")
        self._moved = self._moved + moved_px() if repeated else 0.0
        self._repeated = self._repeated + 1 if repeated else 0
        if repeated and self._moved > UNSEEN_MOTION:
            text = f"the same image again although the robot has moved by {self._moved:.1f} px in it"
            return gray, Fault(FaultKind.FROZEN, text, stops=self._repeated % TRIED_AGAIN > 0)
        self._contrast = _usual(self._contrast, contrast)
        return self._repaired(gray)

    def _repaired(self, gray: np.ndarray) -> tuple[np.ndarray, Fault | None]:
        """The image with its wrong pixels replaced, where there are more of them than usual."""
        median = cv2.medianBlur(gray, 3)
        wrong = cv2.absdiff(gray, median) > OUTSTANDING
        share = float(np.count_nonzero(wrong)) / gray.size
        usual = self._outstanding
        if usual is None or share <= 2 * usual + MORE_OUTSTANDING:
            self._outstanding = _usual(usual, share)
            return gray, None
        # Two wrong pixels out of nine leave the median right; where more are, twice.
        repaired = np.where(wrong, cv2.medianBlur(median, 3), gray)
        text = f"{100 * share:.1f} % of the pixels stand out; {100 * usual:.1f} % are usual"
        return repaired, Fault(FaultKind.NOISE, text, stops=False, holds=False)


def _usual(before: float | None, now: float) -> float:
    return now if before is None else before + USUAL * (now - before)
