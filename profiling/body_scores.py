"""Scores of body models at postures that they have not seen: figures, summaries over arms, and the tables of both."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from metrics import Metric

from dense_vs.sims.engine.built_scenes import ARM_NAMES

UNITS: dict[str, tuple[str, Literal["higher", "lower"]]] = {
    "points_median": ("px", "lower"),
    "points_p90": ("px", "lower"),
    "stays_p90": ("px", "lower"),
    "known_p90": ("px", "lower"),
    "known_share": ("", "higher"),
    "jacobian_median": ("", "lower"),
    "jacobian_p90": ("", "lower"),
    "overlap": ("", "higher"),
    "depth": ("", "lower"),
    "within": ("", "higher"),
    "link_share": ("", "higher"),
    "point_link_share": ("", "higher"),
    "fit_seconds": ("s", "lower"),
    "fit_cpu_seconds": ("s", "lower"),
    "predict_ms": ("ms", "lower"),
}
DISTANCES = ("points_median", "points_p90", "known_p90")  # infinite where the model does not know enough points
HEADER = (
    "arm, camera", "images", "seed", "points [px]", "90 %", "others stay", "known", "their 90 %", "J error", "90 %",
    "label IoU", "depth", "within 1 s.d.", "links", "of tracks", "of points", "of tracks", "fit [s]", "CPU [s]",
    "J image [ms]",
)  # fmt: skip


@dataclass(frozen=True)
class BodyScore:
    """One arm before one camera; NaN throughout where no body was found.

    Attributes:
        arm, camera, images, seed: which.
        points_median, points_p90: how far off surface points are [px], infinite for one that the model does not know.
        stays_p90: the same where one that it takes for the background stays where it is, as the background does.
        known_p90: the same of those that it knows.
        known_share: how many these are.
        jacobian_median, jacobian_p90: errors of J over the robot's pixels, means over the postures.
        overlap: intersection over union of the model's pixels with the robot's, mean.
        depth: relative error of the robot's pixels, median, with one scale for all postures.
        within: share of the surface's places within one standard deviation of the model's; 0.68 is right.
        link_share: of the tracks with a true link, those on it.
        tracks: how many have one.
        point_link_share, point_tracks: the same of those that stay with the surface point at which they began.
        fit_seconds, fit_cpu_seconds: of the fit, tracks included; by the clock, and of all cores.
        predict_ms: of a J of the whole image, the least.
        failure: why no body was found; "" where one was.
    """

    arm: str
    camera: str
    images: str
    seed: int
    points_median: float = float("nan")
    points_p90: float = float("nan")
    stays_p90: float = float("nan")
    known_p90: float = float("nan")
    known_share: float = float("nan")
    jacobian_median: float = float("nan")
    jacobian_p90: float = float("nan")
    overlap: float = float("nan")
    depth: float = float("nan")
    within: float = float("nan")
    link_share: float = float("nan")
    tracks: int = 0
    point_link_share: float = float("nan")
    point_tracks: int = 0
    fit_seconds: float = float("nan")
    fit_cpu_seconds: float = float("nan")
    predict_ms: float = float("nan")
    failure: str = ""

    @classmethod
    def of_row(cls, row: dict[str, Any]) -> "BodyScore":
        """As a file holds it, where infinite figures and those that are not known are both ``null``."""
        far = math.nan if row["failure"] else math.inf
        known = {name: far if name in DISTANCES else math.nan for name, value in row.items() if value is None}
        return cls(**{**row, **known})

    @property
    def name(self) -> str:
        """Arm, camera, images and seed."""
        return " ".join(part for part in (self.arm, self.camera, self.images, str(self.seed)) if part)


def metrics_of(scores: Iterable[BodyScore]) -> list[Metric]:
    """Every figure as a metric."""
    return [
        Metric(f"body_model/{score.name}/{field}", getattr(score, field), unit, direction)
        for score in scores
        for field, (unit, direction) in UNITS.items()
    ]


def rows_of(scores: Iterable[BodyScore]) -> list[list[str]]:
    """A row of words for each, as :data:`HEADER` names them."""
    return [
        [f"{score.arm} {score.camera}".strip(), score.images, str(score.seed), *_figures(score)] for score in scores
    ]


def _figures(score: BodyScore) -> list[str]:
    return [
        f"{score.points_median:.2f}", f"{score.points_p90:.2f}", f"{score.stays_p90:.2f}", f"{score.known_share:.2f}",
        f"{score.known_p90:.2f}", f"{score.jacobian_median:.3f}",
        f"{score.jacobian_p90:.2f}", f"{score.overlap:.2f}", f"{score.depth:.3f}", f"{score.within:.2f}",
        f"{score.link_share:.2f}", str(score.tracks), f"{score.point_link_share:.2f}", str(score.point_tracks),
        f"{score.fit_seconds:.1f}", f"{score.fit_cpu_seconds:.1f}", f"{score.predict_ms:.1f}",
    ]  # fmt: skip


class Summary:
    """Several scores together; what is said of a figure is of the bodies that were found, NaN where none was.

    Args:
        scores: of these arms.

    Attributes:
        count: of the scores.
        found: of how many a body was found.
    """

    def __init__(self, scores: Iterable[BodyScore]):
        self._scores = tuple(scores)
        self._known = [score for score in self._scores if not score.failure]
        self.count, self.found = len(self._scores), len(self._known)

    def middle(self, field: str) -> float:
        """Median of a figure, the worse of two in the middle."""
        values = self._values(field)
        method = "higher" if UNITS[field][1] == "lower" else "lower"
        return float(np.quantile(values, 0.5, method=method)) if values else float("nan")

    def worst(self, field: str) -> float:
        """The worst of a figure."""
        return (max if UNITS[field][1] == "lower" else min)(self._values(field), default=float("nan"))

    def holding(self, field: str, limit: float) -> int:
        """How many keep to a limit: at most that where less is better, else at least; a body not found does not."""
        return sum(value <= limit if UNITS[field][1] == "lower" else value >= limit for value in self._values(field))

    def _values(self, field: str) -> list[float]:
        return [getattr(score, field) for score in self._known]


def summary(scores: Sequence[BodyScore], ours: bool, images: str) -> Summary:
    """Those of our own arms, or of the commercial ones, with one kind of images."""
    return Summary(score for score in scores if (score.arm not in ARM_NAMES) == ours and score.images == images)
