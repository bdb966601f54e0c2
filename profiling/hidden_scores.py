"""Scores of what is hidden: J and labels behind something that passes, and reaches that lead out of sight and back."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from metrics import Metric

MOST_RATIO = 1.3  # of J's error right after something was in front to that before
LEAST_OVERLAP = 0.8  # of the labels, then and meanwhile
THERE_PX = 3.0  # by the truth


@dataclass(frozen=True)
class CoveredScore:
    """Something in front of the robot for some seconds.

    Attributes:
        seed: of robot, motion and what is in front.
        share: of the robot's pixels that were covered, on average.
        j_before, j_after: median error of J on the robot's pixels, mean of the 3 s before and of the 5 frames after.
        covered_before, covered_after: the same on the place that was covered.
        j_without, covered_without: as after, of a twin with nothing in front, as J's error goes with the posture.
        overlap_before, overlap_after: labels and true robot, intersection over union.
        overlap_meanwhile: mean of the same while something is in front, the robot behind it included.
        covered_overlap: the same of the covered pixels alone.
    """

    seed: int
    share: float
    j_before: float
    j_after: float
    covered_before: float
    covered_after: float
    overlap_before: float
    overlap_after: float
    overlap_meanwhile: float
    covered_overlap: float
    j_without: float
    covered_without: float

    @property
    def ratio(self) -> float:
        """The larger of the two ratios of errors after to before; infinite where one is not known."""
        return self._ratio_to(self.j_before, self.covered_before)

    @property
    def ratio_without(self) -> float:
        """The same to the errors of the twin."""
        return self._ratio_to(self.j_without, self.covered_without)

    def _ratio_to(self, whole: float, place: float) -> float:
        ratios = np.array([self.j_after, self.covered_after]) / np.maximum([whole, place], 1e-12)
        return float(ratios.max()) if np.isfinite(ratios).all() else float("inf")

    @property
    def good(self) -> bool:
        """Whether J and labels are as asked for."""
        overlaps = (self.overlap_after, self.overlap_meanwhile, self.covered_overlap)
        return self.ratio <= MOST_RATIO and all(overlap >= LEAST_OVERLAP for overlap in overlaps)


@dataclass(frozen=True)
class HiddenReach:
    """A reach to a place where the point is not seen, and one back to where it is.

    Attributes:
        seed: of everything.
        where: ``"behind"`` an object or ``"outside"`` of the image.
        unseen_frames: in which the true point was not seen.
        away_end, away_px: what the loop says at the place where it is not seen, and the true point's distance [px].
        end, true_px: the same at the last target.
        said_frames: how many of these the loop said it was not seen in.
    """

    seed: int
    where: str
    unseen_frames: int
    away_end: str
    away_px: float
    end: str
    true_px: float
    said_frames: int

    @property
    def good(self) -> bool:
        """Whether the true point ends at the last target, whatever the loop says."""
        return self.true_px < THERE_PX

    @property
    def wrong(self) -> bool:
        """Whether the loop says that the point is at a target where it is not."""
        away = self.away_end == "reached" and not self.away_px < THERE_PX
        return away or (self.end == "reached" and not self.good)

    @property
    def flagged(self) -> bool:
        """Whether the loop does not say that a point is there that is not."""
        return not self.good and self.end != "reached"


def share_of_both(labels: np.ndarray, mask: np.ndarray) -> float:
    """Intersection over union of two masks; NaN where both are empty."""
    union = int((labels | mask).sum())
    return float((labels & mask).sum() / union) if union else float("nan")


def metrics_of(covered: Sequence[CoveredScore], reaches: Sequence[HiddenReach]) -> list[Metric]:
    """Every figure."""
    metrics = []
    for row in covered:
        name = f"covered for 3 s, seed {row.seed}"
        metrics += [
            Metric(f"{name}: J error after to before", row.ratio, "1", "lower"),
            Metric(f"{name}: J error after to a twin's", row.ratio_without, "1", "lower"),
            Metric(f"{name}: label IoU after", row.overlap_after, "1", "higher"),
            Metric(f"{name}: label IoU meanwhile", row.overlap_meanwhile, "1", "higher"),
            Metric(f"{name}: label IoU of what is hidden", row.covered_overlap, "1", "higher"),
        ]
    for where in dict.fromkeys(reach.where for reach in reaches):
        of = [reach for reach in reaches if reach.where == where]
        counts: tuple[tuple[str, int, Literal["higher", "lower"]], ...] = (
            ("reaches", len(of), "higher"),
            (f"below {THERE_PX:g} px", sum(reach.good for reach in of), "higher"),
            ("not there, and said", sum(reach.flagged for reach in of), "higher"),
            ("frames unseen", sum(reach.unseen_frames for reach in of), "higher"),
            ("frames unseen, and said", sum(reach.said_frames for reach in of), "higher"),
            ("wrongly said reached", sum(reach.wrong for reach in of), "lower"),
        )
        for text, count, better in counts:
            unit = "frames" if "frames" in text else "reaches"
            metrics.append(Metric(f"{where}: {text}", count, unit, better))
    return metrics
