"""Scores of body models at postures that they have not seen: figures, summaries over arms, and the tables of both."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from metrics import Metric

from dense_vs.sims.engine.built_scenes import ARM_NAMES

UNITS = {
    "points_median": ("px", "lower"),
    "points_p90": ("px", "lower"),
    "jacobian_median": ("", "lower"),
    "jacobian_p90": ("", "lower"),
    "overlap": ("", "higher"),
    "depth": ("", "lower"),
    "within": ("", "higher"),
    "link_share": ("", "higher"),
    "fit_cpu_seconds": ("s", "lower"),
    "predict_ms": ("ms", "lower"),
}
HEADER = (
    "arm, camera", "images", "seed", "points [px]", "90 %", "J error", "90 %", "label IoU", "depth", "within 1 s.d.",
    "links", "of tracks", "fit, CPU [s]", "J image [ms]",
)  # fmt: skip


@dataclass(frozen=True)
class BodyScore:
    """One arm before one camera; NaN throughout where no body was found.

    Attributes:
        arm, camera, images, seed: which.
        points_median, points_p90: how far off surface points are [px], infinite for one that the model does not know.
        jacobian_median, jacobian_p90: errors of J over the robot's pixels, means over the postures.
        overlap: intersection over union of the model's pixels with the robot's, mean.
        depth: relative error of the robot's pixels, median, with one scale for all postures.
        within: share of the surface's places within one standard deviation of the model's; 0.68 is right.
        link_share: of the tracks with a true link, those on it.
        tracks: how many have one.
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
    jacobian_median: float = float("nan")
    jacobian_p90: float = float("nan")
    overlap: float = float("nan")
    depth: float = float("nan")
    within: float = float("nan")
    link_share: float = float("nan")
    tracks: int = 0
    fit_seconds: float = float("nan")
    fit_cpu_seconds: float = float("nan")
    predict_ms: float = float("nan")
    failure: str = ""

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
        f"{score.points_median:.2f}", f"{score.points_p90:.2f}", f"{score.jacobian_median:.3f}",
        f"{score.jacobian_p90:.2f}", f"{score.overlap:.2f}", f"{score.depth:.3f}", f"{score.within:.2f}",
        f"{score.link_share:.2f}", str(score.tracks), f"{score.fit_cpu_seconds:.1f}", f"{score.predict_ms:.1f}",
    ]  # fmt: skip


@dataclass(frozen=True)
class Summary:
    """Several scores together: the mean and the worst of a figure, a body that was not found as the worst.

    Attributes:
        count: of the scores.
        found: how many bodies were found.
    """

    scores: tuple[BodyScore, ...]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.scores)

    @property
    def found(self) -> int:
        """Of how many a body was found."""
        return sum(not score.failure for score in self.scores)

    def mean(self, field: str) -> float:
        """Of a figure over the bodies that were found; NaN where none was."""
        known = [getattr(score, field) for score in self.scores if not score.failure]
        return float(np.mean(known)) if known else float("nan")

    def middle(self, field: str) -> float:
        """Median of a figure over the bodies that were found, which one that is infinite does not spoil."""
        known = [getattr(score, field) for score in self.scores if not score.failure]
        return float(np.quantile(known, 0.5, method="higher")) if known else float("nan")

    def worst(self, field: str) -> float:
        """Of a figure over the bodies that were found."""
        known = [getattr(score, field) for score in self.scores if not score.failure]
        choose = max if UNITS[field][1] == "lower" else min
        return choose(known, default=float("nan"))

    def holding(self, limits: dict[str, float]) -> int:
        """How many keep to all limits: at most where less is better, else at least; one that was not found does not."""
        return sum(
            all(
                getattr(score, field) <= limit if UNITS[field][1] == "lower" else getattr(score, field) >= limit
                for field, limit in limits.items()
            )
            for score in self.scores
        )


def summary(scores: Sequence[BodyScore], ours: bool, images: str) -> Summary:
    """Those of our own arms, or of the commercial ones, with one kind of images."""
    return Summary(tuple(score for score in scores if (score.arm not in ARM_NAMES) == ours and score.images == images))
