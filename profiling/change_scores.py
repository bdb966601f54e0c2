"""Scores of what is found to have changed since a body was learned, their summaries and tables."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from metrics import Metric

from dense_vs.body_model import BodyChange, ChangeKind

HEADER = (
    "arm, camera", "images", "seed", "changed", "found", "right", "offset", "its error", "off [px]", "looks alike",
    "after", "J error", "after",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What has truly changed.

    Attributes:
        kind: what.
        offsets: ``(N,)`` by which readings are larger [rad].
        position, angle: by which the camera was moved at most [m], [rad].
    """

    kind: ChangeKind
    offsets: np.ndarray
    position: float = 0.0
    angle: float = 0.0

    def named(self, change: BodyChange) -> bool:
        """Whether a change is of this kind and, where it is one joint's, of this joint."""
        if change.kind is not self.kind:
            return False
        joint = int(np.argmax(np.abs(self.offsets)))
        return self.kind is not ChangeKind.JOINT or int(np.argmax(np.abs(change.offsets))) == joint

    def among(self, change: BodyChange) -> bool:
        """Whether it is named, or one of its rivals is this."""
        return any(self.named(one) for one in (change, *change.rivals))


@dataclass(frozen=True)
class ChangeScore:
    """One change of one body.

    Attributes:
        arm, camera, images, seed: which body.
        changed, found: what has, and what is said to have.
        named, among: whether that is right, or one of those that are said to look alike.
        offset, offset_error: of the joints' zeros, the largest [rad], and the largest error of what is found.
        off: px that the body's patches were off, by the images.
        agreement_before, agreement: how much images look like the body, before and after, see :class:`.BodyChange`.
        before, after: J's error without an image, before and after the change is taken into account.
        failure: why no body was found; "" where one was.
    """

    arm: str
    camera: str
    images: str
    seed: int
    changed: str = ""
    found: str = ""
    named: bool = False
    among: bool = False
    offset: float = math.nan
    offset_error: float = math.nan
    off: float = math.nan
    agreement_before: float = math.nan
    agreement: float = math.nan
    before: float = math.nan
    after: float = math.nan
    failure: str = ""

    @classmethod
    def of_row(cls, row: dict[str, Any]) -> "ChangeScore":
        """As a file holds it, where figures that are not known are ``null``."""
        return cls(**{name: math.nan if value is None else value for name, value in row.items()})

    @property
    def body(self) -> str:
        """Arm, camera, images and seed."""
        return " ".join(part for part in (self.arm, self.camera, self.images, str(self.seed)) if part)


def metrics_of(scores: Iterable[ChangeScore]) -> list[Metric]:
    """For every kind of change, how many are named rightly and what J's error is after it."""
    found = []
    for kind in ChangeKind:
        some = [score for score in scores if score.changed == kind]
        if some:
            share = sum(score.named for score in some) / len(some)
            found.append(Metric(f"body_changes/{kind}/named", share, "", "higher"))
            found.append(Metric(f"body_changes/{kind}/after", median_of(some, "after"), "", "lower"))
    return found


def median_of(scores: Sequence[ChangeScore], field: str) -> float:
    """Median of a figure, the larger of two in the middle; NaN of none."""
    values = [getattr(score, field) for score in scores]
    return float(np.quantile(values, 0.5, method="higher")) if values else math.nan


def rows_of(scores: Iterable[ChangeScore]) -> list[list[str]]:
    """A row of words for each, as :data:`HEADER` names them."""
    return [
        [f"{score.arm} {score.camera}".strip(), score.images, str(score.seed), *(_figures(score))] for score in scores
    ]


def _figures(score: ChangeScore) -> list[str]:
    if score.failure:
        return [score.failure, *[""] * 9]
    right = "yes" if score.named else "among" if score.among else "no"
    return [
        score.changed, score.found, right, f"{score.offset:.3f}", f"{score.offset_error:.3f}", f"{score.off:.1f}",
        f"{score.agreement_before:.2f}", f"{score.agreement:.2f}", f"{score.before:.3f}", f"{score.after:.3f}",
    ]  # fmt: skip


def summary_rows(scores: Sequence[ChangeScore]) -> list[list[str]]:
    """A row for every kind of change: how many there are, and how many are named, or among those named."""
    rows = []
    for kind in ChangeKind:
        some = [score for score in scores if score.changed == kind]
        if some:
            named, among = (sum(getattr(score, field) for score in some) for field in ("named", "among"))
            rows.append([str(kind), str(len(some)), str(named), str(among)])
    return rows
