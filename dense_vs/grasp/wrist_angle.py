"""The wrist angle of least collision, VOS-VS (22): argmin over q of |M and M_grasp(q)| / |M or M_grasp(q)|.

For a small object many angles have no intersection at all, and (22) does not choose among them. Beyond the paper, the
fingers' distance to the object decides then, which puts the closing direction across the object's narrow side, and
after that the smaller turn.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import number_array, plain_array
from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.segmentation.mask_features import mask_overlap
from dense_vs.segmentation.segmenter import check_mask


class WristVerdict(Enum):
    """Whether the chosen angle is worth closing the gripper at."""

    CLEAR = "clear"  # no finger on the object, something between the fingers
    TOUCHING = "touching"  # some intersection at every angle: too wide, or not centered
    MISSING = "missing"  # nothing between the fingers at the chosen angle
    EMPTY = "empty"  # no object in the mask: the angle stays as it is


@dataclass(frozen=True)
class WristChoice:
    """The answer of VOS-VS (22) for A candidates.

    Attributes:
        verdict: see :class:`WristVerdict`.
        angle: the chosen change of the wrist angle [rad].
        index: of it among the candidates, -1 when the mask is empty.
        iou: VOS-VS (22) at it; nan when the mask is empty.
        ious: VOS-VS (22) at every candidate (A,).
        clearance: distance between fingers and object in the image at the chosen angle [px], 0 when they touch.
        between: object pixels between the fingers at the chosen angle; -1 where no closing masks were given.
    """

    verdict: WristVerdict
    angle: float
    index: int
    iou: float
    ious: np.ndarray
    clearance: float
    between: int


def choose_wrist_angle(
    mask: Any,
    finger_masks: Any,
    angles: Any,
    *,
    closing_masks: Any = None,
    rank: int = 0,
    iou_tolerance: float = 1e-3,
    clearance_tolerance: float = 1.5,
) -> WristChoice:
    """Choose the wrist angle by VOS-VS (22).

    Args:
        mask: the object M, bool ``(H, W)``.
        finger_masks: M_grasp at every candidate, bool ``(A, H, W)``, see :meth:`GripperModel.finger_masks`.
        angles: changes of the wrist angle they belong to (A,) [rad].
        closing_masks: room between the fingers at every candidate, same shape; without them the verdict is never
            ``MISSING``.
        rank: 0 for the best candidate; 1 for the best that is at least a quarter of the candidates' range away
            from it, for another attempt.
        iou_tolerance: values of VOS-VS (22) closer than that count as equal.
        clearance_tolerance: distances closer than that [px] count as equal.

    Raises:
        DenseVSError: shapes that do not fit, no candidate, or angles that are not finite.
    """
    mask = check_mask(mask)
    fingers = _candidates(finger_masks, "finger_masks", mask.shape)
    turns = number_array(angles, "angles", (len(fingers),))
    between = None
    if closing_masks is not None:
        between = mask_overlap(mask, _candidates(closing_masks, "closing_masks", mask.shape, len(fingers))).intersection
    rank = check_whole("rank", rank, least=0, most=1)
    iou_tolerance = check_number("iou_tolerance", iou_tolerance, least=0.0)
    clearance_tolerance = check_number("clearance_tolerance", clearance_tolerance, least=0.0)
    ious = intersection_over_union(mask, fingers)
    if not mask.any():
        empty = np.full(len(turns), np.nan)
        return WristChoice(WristVerdict.EMPTY, 0.0, -1, float("nan"), empty, float("nan"), 0)
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    clearance = np.array([distance[finger].min(initial=np.inf) for finger in fingers])
    allowed = np.ones(len(turns), dtype=bool)
    index = _best(ious, clearance, turns, allowed, iou_tolerance, clearance_tolerance)
    if rank == 1:
        apart = np.abs(turns - turns[index]) >= np.ptp(turns) / 4
        if apart.any():
            index = _best(ious, clearance, turns, apart, iou_tolerance, clearance_tolerance)
    verdict = WristVerdict.CLEAR
    if ious[index] > iou_tolerance:
        verdict = WristVerdict.TOUCHING
    if between is not None and not between[index]:
        verdict = WristVerdict.MISSING
    return WristChoice(
        verdict,
        float(turns[index]),
        index,
        float(ious[index]),
        ious,
        float(clearance[index]),
        -1 if between is None else int(between[index]),
    )


def intersection_over_union(mask: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """VOS-VS (22), the Jaccard index (A,) float64 of a mask ``(H, W)`` with every candidate ``(A, H, W)``.

    0 where both are empty.

    Raises:
        DenseVSError: not masks, or of different shapes.
    """
    mask = check_mask(mask)
    return mask_overlap(mask, _candidates(candidates, "candidates", mask.shape)).jaccard


def _best(
    ious: np.ndarray,
    clearance: np.ndarray,
    turns: np.ndarray,
    allowed: np.ndarray,
    iou_tolerance: float,
    clearance_tolerance: float,
) -> int:
    least = allowed & (ious <= ious[allowed].min() + iou_tolerance)
    if ious[allowed].min() <= iou_tolerance:
        least &= clearance >= clearance[least].max() - clearance_tolerance
    candidates = np.flatnonzero(least)
    return int(candidates[np.argmin(np.abs(turns[candidates]))])


def _candidates(masks: Any, name: str, shape: tuple[int, ...], count: int | None = None) -> np.ndarray:
    array = plain_array(masks, name, "bool of shape (A, H, W)")
    fits = array.ndim == 3 and array.shape[1:] == shape and len(array) and count in (None, len(array))
    if not fits or array.dtype.kind not in "bui":
        raise DenseVSError(
            f"{name} have shape {array.shape} and dtype {array.dtype}; "
            f"expected bool of shape ({'A' if count is None else count}, {shape[0]}, {shape[1]})"
        )
    return array.astype(bool, copy=False)
