"""Quality of a mask, as a typed result that a servo loop can act on; beyond the paper.

Segmentation errors are the paper's only cause of failures (section 7.4): masks that are empty, in several parts, cut
by the image border, or leaking over the background. The figures here need nothing but the mask and the one before.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import cv2
import numpy as np

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.segmentation.mask_features import connected_regions, mask_overlap, mask_sums
from dense_vs.segmentation.segmenter import check_mask


class MaskVerdict(Enum):
    """Verdict on a mask; the worst that applies."""

    GOOD = "good"  # one region inside the image
    CUT = "cut"  # touches the image border or what hides the scene: centroid and area are of a part
    SPLIT = "split"  # a large share lies outside the largest region
    JUMPED = "jumped"  # area or place changed more than a moving camera explains
    FLOODED = "flooded"  # covers almost the whole image
    EMPTY = "empty"  # no object


@dataclass(frozen=True)
class MaskQuality:
    """One mask's figures.

    Attributes:
        verdict: the worst of what applies.
        area: pixels s_A, VOS-VS (3).
        centroid: (s_x, s_y), VOS-VS (4) and VOS-VS (5) [px]; nan when empty.
        fraction: area over the image's.
        parts: number of 8-connected regions.
        largest_share: share of the area in the largest region, 0 when empty.
        border_share: share of the image's border pixels that the mask covers.
        overlap: intersection over union with the previous mask; nan without one.
        box: (x, y, width, height) of the mask [px]; zeros where no pixel is set.
        border: image sides that the mask touches: sum of 1 left, 2 right, 4 top, 8 bottom.
    """

    verdict: MaskVerdict
    area: int
    centroid: tuple[float, float]
    fraction: float
    parts: int
    largest_share: float
    border_share: float
    overlap: float
    box: tuple[int, int, int, int]
    border: int

    @property
    def servoable(self) -> bool:
        """Whether the centroid tells where to move: something is seen, if only a part, and it is not everything."""
        return self.verdict in (MaskVerdict.GOOD, MaskVerdict.CUT, MaskVerdict.SPLIT)

    @property
    def measurable(self) -> bool:
        """Whether the area belongs to the whole object, as VOS-VS (20) and (23) need."""
        return self.verdict is MaskVerdict.GOOD


def assess_mask(
    mask: Any,
    previous: Any = None,
    *,
    hidden: Any = None,
    min_area: int = 16,
    max_fraction: float = 0.9,
    min_largest_share: float = 0.75,
    max_area_ratio: float = 4.0,
) -> MaskQuality:
    """Judge a mask by itself and, where given, against the one before it.

    Args:
        mask: bool ``(H, W)``.
        previous: mask of the frame before, same shape.
        hidden: bool ``(H, W)``, where something known stands before the scene, as the robot's own gripper does.
        min_area: fewer pixels count as no object.
        max_fraction: a larger share of the image counts as flooded.
        min_largest_share: a smaller share in the largest region counts as split.
        max_area_ratio: a larger growth or shrinkage between masks that do not overlap either counts as a jump.

    Raises:
        DenseVSError: not masks, or of different shapes, or an option out of range.
    """
    least_area = check_number("min_area", min_area, least=0)
    max_fraction = check_number("max_fraction", max_fraction, least=0)
    min_largest_share = check_number("min_largest_share", min_largest_share, least=0)
    max_area_ratio = check_number("max_area_ratio", max_area_ratio, least=0)
    mask = check_mask(mask)
    hidden = None if hidden is None else _alike(hidden, "hidden", mask)
    whole = mask_sums(mask)
    area, overlap, area_before = int(whole.area), float("nan"), 0
    if previous is not None:
        before = _alike(previous, "previous", mask)
        area_before = int(mask_sums(before).area)
        shared = mask_overlap(mask, before[None])
        overlap = float(shared.jaccard[0]) if shared.union[0] else float("nan")
    fraction, border = area / mask.size, int(whole.border)
    left, top, width, height = whole.box.tolist()
    box = (left, top, width, height)
    if area < max(least_area, 1):
        nowhere = (float("nan"), float("nan"))
        return MaskQuality(MaskVerdict.EMPTY, area, nowhere, fraction, 0, 0.0, 0.0, overlap, box, border)
    _, regions = connected_regions(mask)
    largest_share = float(regions.area.max() / area)
    ratio = max(area, area_before) / max(min(area, area_before), 1)
    if fraction > max_fraction:
        verdict = MaskVerdict.FLOODED
    elif area_before >= least_area and overlap == 0 and ratio > max_area_ratio:
        verdict = MaskVerdict.JUMPED
    elif largest_share < min_largest_share:
        verdict = MaskVerdict.SPLIT
    elif border or _touches(mask, hidden):
        verdict = MaskVerdict.CUT
    else:
        verdict = MaskVerdict.GOOD
    x, y = whole.centroid.tolist()
    return MaskQuality(
        verdict,
        area,
        (x, y),
        fraction,
        len(regions.area),
        largest_share,
        _border_share(mask) if border else 0.0,
        overlap,
        box,
        border,
    )


def _border_share(mask: np.ndarray) -> float:
    """Share of the image's border pixels that the mask covers."""
    height, width = mask.shape
    covered = np.count_nonzero(mask[[0, -1]]) + np.count_nonzero(mask[1:-1, [0, -1]])
    return covered / (2 * (height + width) - 4)


def _touches(mask: np.ndarray, hidden: np.ndarray | None) -> bool:
    """Whether a mask comes within three pixels of what is hidden, as outlines err by as much."""
    if hidden is None:
        return False
    near = cv2.dilate(hidden.view(np.uint8), np.ones((7, 7), np.uint8))
    return bool(mask_overlap(mask, near[None]).intersection[0])


def _alike(other: Any, name: str, mask: np.ndarray) -> np.ndarray:
    other = check_mask(other, name)
    if other.shape != mask.shape:
        raise DenseVSError(f"{name} has shape {other.shape}; expected the mask's, {mask.shape}")
    return other
