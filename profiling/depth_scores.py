"""Scores of depth: of J's row of depth, of the depth of the robot's pixels, and of reaches in space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from metrics import Metric

WITHIN_M = 0.008  # m, of a reach that counts as there


@dataclass(frozen=True)
class RowScore:
    """Error of the row of depth at the robot's pixels that the joints move.

    Attributes:
        median, p90: |D - D*| / |D*|.
        of_motion: median of |D - D*| by the size of the point's whole motion in space: where it moves across the line
            of sight, D* is small and its relative error says little.
    """

    median: float
    p90: float
    of_motion: float


def row_score(estimated: np.ndarray, true: np.ndarray, motion: np.ndarray, mask: np.ndarray) -> RowScore:
    """Compare rows of depth ``(H, W, N)`` [m/rad] over a bool mask ``(H, W)``.

    Args:
        estimated, true: the rows.
        motion: ``(H, W)`` size of the true motion in space by all joints, Frobenius norm of (3, N) [m/rad].
        mask: the robot's pixels.
    """
    counted = mask & (np.linalg.norm(true, axis=2) > 0)
    if not counted.any():
        return RowScore(*[float("nan")] * 3)
    off = np.linalg.norm(estimated - true, axis=2)[counted]
    relative = off / np.linalg.norm(true, axis=2)[counted]
    return RowScore(
        float(np.median(relative)), float(np.quantile(relative, 0.9)), float(np.median(off / motion[counted]))
    )


@dataclass(frozen=True)
class DepthScore:
    """Relative error of depth at the robot's pixels; one whose depth is not known counts as infinitely far off.

    Attributes:
        median, p90: over all of them.
        unknown: share of those not known.
    """

    median: float
    p90: float
    unknown: float


def depth_score(depth: np.ndarray, true: np.ndarray, mask: np.ndarray) -> DepthScore:
    """Compare depth images ``(H, W)`` [m] over a bool mask ``(H, W)``; 0, NaN and infinite are not known."""
    found, exact = depth[mask], true[mask]
    if not len(found):
        return DepthScore(*[float("nan")] * 3)
    known = np.isfinite(found) & (found > 0)
    off = np.where(known, np.abs(np.where(known, found, 0) - exact) / exact, np.inf)
    return DepthScore(
        float(np.quantile(off, 0.5, method="higher")),
        float(np.quantile(off, 0.9, method="higher")),
        float(np.mean(~known)),
    )


@dataclass(frozen=True)
class SpaceReach:
    """One reach.

    Attributes:
        end: ``"reached"``, ``"missed"`` or ``"lost"``, as the loop says.
        error_m: distance of the true point from the target in space at the end [m].
        error_px: the same in the image [px].
        depth_m: of the depth that the loop takes the point to be at from the true one [m].
        frames: that it took.
    """

    end: str
    error_m: float
    error_px: float
    depth_m: float
    frames: int


def reach_metrics(reaches: Sequence[SpaceReach]) -> list[Metric]:
    """How many are there by the truth and by what is said, and how far they are off."""
    errors = np.array([1e3 * reach.error_m for reach in reaches])
    there = errors < 1e3 * WITHIN_M  # false for what is no number
    said = np.array([reach.end == "reached" for reach in reaches])
    lost = sum(reach.end == "lost" for reach in reaches)
    return [
        Metric("reaches", len(reaches), "reaches", "higher"),
        Metric(f"reaches below {1e3 * WITHIN_M:g} mm", int(there.sum()), "reaches", "higher"),
        Metric("said reached", int(said.sum()), "reaches", "higher"),
        Metric("wrongly said reached", int((said & ~there).sum()), "reaches", "lower"),
        Metric("said lost", lost, "reaches", "lower"),
        Metric("reach error in space, median", float(np.median(errors)), "mm", "lower"),
        Metric("reach error in space, worst", float(errors.max()), "mm", "lower"),
        Metric("reach error in the image, median", float(np.median([r.error_px for r in reaches])), "px", "lower"),
        Metric("depth of the point, median error", float(np.median([1e3 * r.depth_m for r in reaches])), "mm", "lower"),
        Metric("reach frames, median", float(np.median([r.frames for r in reaches])), "frames", "lower"),
    ]
