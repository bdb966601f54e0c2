"""Scores of the consecutive trials, VOS-VS section 7.4, from what the robot believes and what the simulator knows.

VS: the object was centered. DE: the gripper could close on the object at the depth that was estimated.
DE done: it went there and closed on it.
"""

from dataclasses import dataclass

import numpy as np

from dense_vs.grasp import grasp_camera_position
from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.segmentation.mask_features import mask_overlap
from dense_vs.sims.mobile_manipulator.postures import CAMERA_ABOVE_LIFT, FINGERTIP, Z_GRIPPER

CENTERED_PX = 25.0  # truth: largest offset of a centered object
LIFTED = 0.05  # m, that an object in the gripper rises at least


@dataclass(frozen=True)
class ServoScore:
    """VS of one object.

    Attributes:
        centered: whether the run converged and the object's true centroid is within :data:`CENTERED_PX` of s*.
        cause: of a failure; empty for none.
    """

    centered: bool
    cause: str = ""


@dataclass(frozen=True)
class TrueView:
    """Truth on the view that a depth estimate refers to.

    Attributes:
        outline: mean depth of the object's outline [m].
        surface: mean depth of its visible surface [m].
        top: least depth [m].
        iou: of the mask with the true one.
        camera_height: above the floor [m].
    """

    outline: float
    surface: float
    top: float
    iou: float
    camera_height: float


@dataclass(frozen=True)
class DepthScore:
    """DE of one object.

    Attributes:
        graspable: whether the gripper could close on the object at the estimated depth.
        error: of the distance at the nearest view, relative to that of the object's outline; nan without an estimate.
        surface_error: the same relative to the mean visible surface.
        margins: at VOS-VS (21) [m]: fingertips above the support, fingertips below the object's top.
        cause: of a failure; empty for none.
    """

    graspable: bool
    error: float = float("nan")
    surface_error: float = float("nan")
    margins: tuple[float, float] = (float("nan"), float("nan"))
    cause: str = ""


@dataclass(frozen=True)
class ReachScore:
    """DE done, of one object.

    Attributes:
        closed: whether the fingers closed on the object from both sides and touched nothing of the room before, nor
            did the palm, with the camera, touch the object.
        lifted: whether the object rose with the gripper.
        cause: of not having closed; empty where it has.
    """

    closed: bool
    lifted: bool = False
    cause: str = ""


def score_servo(end: ServoEnd, offset_px: float, iou: float) -> ServoScore:
    """Whether an object was centered.

    Args:
        end: of the run.
        offset_px: largest component of the true offset from s*; nan where the object is out of view.
        iou: of the last mask with the true one.
    """
    if end is ServoEnd.CONVERGED and offset_px < CENTERED_PX:
        return ServoScore(True)
    where = f"{offset_px:.0f} px off by the truth" if np.isfinite(offset_px) else "the object is out of view"
    return ServoScore(False, f"servo {end.value}, {where}, mask IoU {iou:.2f}")


def score_depth(z_object: float, camera_z: float, true: TrueView, support: float) -> DepthScore:
    """Whether the gripper could close on an object.

    Args:
        z_object: estimated, on the lift's axis [m].
        camera_z: of the view that ``true`` describes, on the same axis [m].
        true: what the simulator knows.
        support: height of what the object rests on [m].
    """
    distance = camera_z - z_object
    # The robot's own kinematics: the lift's position and the camera's height differ by a constant.
    stop = grasp_camera_position(z_object, Z_GRIPPER) + CAMERA_ABOVE_LIFT
    tips = stop - Z_GRIPPER - FINGERTIP
    top = true.camera_height - true.top
    margins = (tips - support, top - tips)
    error, surface_error = (distance - true.outline) / true.outline, (distance - true.surface) / true.surface
    if min(margins) > 0.0 and stop > top:
        return DepthScore(True, error, surface_error, margins)
    missed, by = min(
        ("fingertips hit the support", margins[0]),
        ("gripper closes above the object", margins[1]),
        ("camera hits the object", stop - top),
        key=lambda one: one[1],
    )
    off_mm = 1e3 * (distance - true.outline)
    cause = (
        f"depth error {100 * error:+.1f} % ({off_mm:+.0f} mm): {missed} by {-1e3 * by:.0f} mm; mask IoU {true.iou:.2f}"
    )
    return DepthScore(False, error, surface_error, margins, cause)


def score_reach(judged: tuple[bool, bool, bool] | None, risen: float, servo: ServoEnd | None) -> ReachScore:
    """What a reach is worth.

    Args:
        judged: as the gripper closed: whether the object was between the fingers, whether they had touched the room,
            whether the palm had touched the object; None if it never closed.
        risen: by how much the object's highest point rose with the gripper [m].
        servo: how centering under the gripper ended; None if it was not tried.
    """
    if judged is None:
        why = "the gripper did not open" if servo is None else f"lost under the gripper: servo {servo.value}"
        return ReachScore(False, False, f"did not close, {why}")
    between, support, palm = judged
    met = [
        text
        for wrong, text in (
            (support, "the fingers touched the room"),
            (palm, "the palm touched the object"),
            (not between, "the object was not between the fingers"),
        )
        if wrong
    ]
    return ReachScore(not met, risen > LIFTED, ", ".join(met))


def intersection_over_union(mask: np.ndarray | None, true: np.ndarray) -> float:
    """Of a mask with the true one; 0 without a mask."""
    if mask is None:
        return 0.0
    return float(mask_overlap(mask, true[None]).jaccard[0])
