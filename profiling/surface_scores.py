"""Scores of the surfaces' table: what one arm before one camera came to, and means over arms."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from metrics import Metric

Better = Literal["higher", "lower"]
REACHED_PX = 2.0  # by the truth
ASTRAY_PX = 3.0  # of the tracked from the true point: farther, it is not followed any more

OURS = ("arm", "painted", "planar", "upper-body")  # in no mean; other names and files are commercial arms


@dataclass(frozen=True)
class ReachScore:
    """One reach.

    Attributes:
        end: ``"reached"``, ``"missed"`` or ``"lost"``, as the loop says.
        true_px: distance of the true point from the target at the end [px].
        astray_px: distance of the tracked from the true point at the end [px].
        frames: that it took.
        known_px: standard deviation of the tracked point's place, by its tracker [px]; None where that tells none.
    """

    end: str
    true_px: float
    astray_px: float
    frames: int
    known_px: float | None = None

    @property
    def good(self) -> bool:
        """Whether the true point is at the target, whatever the loop says."""
        return self.true_px < REACHED_PX

    @property
    def wrong(self) -> bool:
        """Whether the loop says that the point is there and it is not."""
        return self.end == "reached" and not self.good

    @property
    def unsaid(self) -> bool:
        """Whether the point was not followed any more and the loop does not say so."""
        return self.end != "lost" and not self.astray_px <= ASTRAY_PX


@dataclass(frozen=True)
class ViewScore:
    """One arm before one camera with one seed.

    Attributes:
        arm, camera, images, seed: which; ``images`` is clean or a preset of realism.
        joints: how many are used.
        targets: reaches that were asked for.
        j_median, j_p90: error of J after babbling; NaN before.
        exact_median: the same with exact flow and joints.
        overlap, precision, recall: labels against the true robot; ``overlap`` is intersection over union.
        delay_frames: of the joint readings, as found.
        reaches: so far.
        failure: what ended it early; empty where nothing did.
        finished: whether nothing is left to do.
        seconds: that it took.
    """

    arm: str
    camera: str
    images: str
    seed: int
    joints: int
    targets: int
    j_median: float = float("nan")
    j_p90: float = float("nan")
    exact_median: float = float("nan")
    overlap: float = float("nan")
    precision: float = float("nan")
    recall: float = float("nan")
    delay_frames: float = float("nan")
    reaches: list[ReachScore] = field(default_factory=list)
    failure: str = ""
    finished: bool = False
    seconds: float = 0.0

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Which view, kind of images and seed."""
        return self.arm, self.camera, self.images, self.seed

    @property
    def ended(self) -> bool:
        """Whether it came to its end, or to a failure: no run was stopped before."""
        return self.finished or bool(self.failure)

    @property
    def learned(self) -> bool:
        """Whether the babbling came to its end."""
        return bool(np.isfinite(self.j_median))


def label_quality(labels: np.ndarray, mask: np.ndarray) -> tuple[float, float, float]:
    """Intersection over union, precision and recall of labels against the true robot, bool ``(H, W)`` each."""
    both = float((labels & mask).sum())
    return both / max(1, (labels | mask).sum()), both / max(1, labels.sum()), both / max(1, mask.sum())


@dataclass(frozen=True)
class Tally:
    """Reaches of some views together. Those that were asked for and did not come about count as not there."""

    asked: int
    made: int
    good: int
    said: int
    wrong: int
    lost: int
    missed: int
    unsaid: int

    @classmethod
    def of(cls, views: Iterable[ViewScore]) -> "Tally":
        """Count."""
        views = list(views)
        reaches = [reach for view in views for reach in view.reaches]
        # A view that was stopped early has not failed at what it was not given time for.
        asked = sum(view.targets if view.ended else len(view.reaches) for view in views)
        ends = [reach.end for reach in reaches]
        return cls(
            asked=asked,
            made=len(reaches),
            good=sum(reach.good for reach in reaches),
            said=ends.count("reached"),
            wrong=sum(reach.wrong for reach in reaches),
            lost=ends.count("lost"),
            missed=ends.count("missed"),
            unsaid=sum(reach.unsaid for reach in reaches),
        )


def view_score(row: dict[str, Any]) -> ViewScore:
    """A view as :func:`dataclasses.asdict` and JSON store it; null is NaN."""
    plain = {name: float("nan") if value is None else value for name, value in row.items()}
    reaches = [
        ReachScore(
            **{name: float("nan") if value is None and name != "known_px" else value for name, value in reach.items()}
        )
        for reach in plain.pop("reaches")
    ]
    return ViewScore(**plain, reaches=reaches)


def over_seeds(views: Sequence[ViewScore]) -> dict[tuple[str, str, str], list[ViewScore]]:
    """Views by arm, camera and images, in the order that they come in."""
    groups: dict[tuple[str, str, str], list[ViewScore]] = {}
    for view in views:
        groups.setdefault(view.key[:3], []).append(view)
    return groups


def mean_of(views: Iterable[ViewScore], name: str) -> float:
    """Mean of a figure over the views that have learned; NaN for none."""
    values = [getattr(view, name) for view in views if view.learned]
    return float(np.mean(values)) if values else float("nan")


def metrics_of(views: Sequence[ViewScore]) -> list[Metric]:
    """Every figure by view, seeds together, and the means over the commercial arms."""
    metrics = []
    for (arm, camera, images), group in over_seeds(views).items():
        name = f"{' '.join(part for part in (arm, camera) if part)}, {images}"
        metrics += _of_group(name, group)
    for images in dict.fromkeys(view.images for view in views):
        arms = [view for view in views if view.images == images and view.arm not in OURS]
        if not arms:
            continue
        metrics += _of_group(f"all arms, {images}", arms)
        worst = [mean_of(group, "j_median") for group in over_seeds(arms).values()]
        worst = [error for error in worst if np.isfinite(error)]
        metrics.append(
            Metric(f"all arms, {images}: J error of the worst view", max(worst, default=np.nan), "1", "lower")
        )
    return metrics


def _of_group(name: str, views: Sequence[ViewScore]) -> list[Metric]:
    figures: tuple[tuple[str, str, Better], ...] = (
        ("J error", "j_median", "lower"),
        ("J error at 90 %", "j_p90", "lower"),
        ("J error with exact flow", "exact_median", "lower"),
        ("label IoU", "overlap", "higher"),
    )
    metrics = [Metric(f"{name}: {text}", mean_of(views, field), "1", better) for text, field, better in figures]
    tally = Tally.of(views)
    if tally.asked:
        counts: tuple[tuple[str, int, Better], ...] = (
            ("reaches", tally.asked, "higher"),
            (f"reaches below {REACHED_PX:g} px", tally.good, "higher"),
            ("said reached", tally.said, "higher"),
            ("wrongly said reached", tally.wrong, "lower"),
            ("said lost", tally.lost, "lower"),
            ("astray and not said", tally.unsaid, "lower"),
        )
        metrics += [Metric(f"{name}: {text}", value, "reaches", better) for text, value, better in counts]
    return metrics
