"""Postures of the mobile manipulator by name, and where its camera then looks."""

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.model import JOINTS

# The grasp camera, the hand pointing down: how far before the base, and above the lift's position [m].
CAMERA_FORWARD = 0.522
CAMERA_ABOVE_LIFT = 0.16
Z_GRIPPER = 0.17  # m from the grasp camera to the center of the closed fingertips, along the optical axis
GRIPPER_BEHIND = 0.037  # m from the grasp camera back to the gripper's axis
FINGERTIP = 0.004  # m that the fingertips reach beyond their center

_HAND_DOWN = {"head_tilt": -0.5, "arm_lift": 0.7, "arm_flex": -np.pi / 2, "wrist_flex": -np.pi / 2}
POSTURES = {
    "above": _HAND_DOWN,  # H_base: the camera high above the objects, looking down
    "low": {**_HAND_DOWN, "arm_lift": 0.05},  # H_base grasp: just above an object on the floor
    "ahead": {"head_tilt": -0.5, "arm_lift": 0.35, "arm_flex": -2.6, "wrist_flex": 0.6},  # H_arm: hand forward
    "gaze": {"head_tilt": -0.6, "arm_lift": 0.15, "arm_flex": -2.7, "wrist_flex": 0.6},  # H_head: arm out of view
}


def posture(name: str, *, forward: float = 0.0, lateral: float = 0.0, **joints: float) -> np.ndarray:
    """Joint positions (10,) of a named posture with the base at a place [m]; further joints as given.

    Raises:
        DenseVSError: an unknown name or joint.
    """
    if name not in POSTURES:
        raise DenseVSError(f"posture {name!r} is unknown; expected one of {', '.join(map(repr, POSTURES))}")
    for joint in joints:
        if joint not in JOINTS:
            raise DenseVSError(f"joint {joint!r} is unknown; expected one of {', '.join(JOINTS)}")
    values = {**POSTURES[name], "base_forward": forward, "base_lateral": lateral, **joints}
    return np.array([values.get(joint, 0.0) for joint in JOINTS])


def above(x: float, y: float, height: float, **joints: float) -> np.ndarray:
    """Joint positions (10,) that bring the grasp camera, looking down, to a place of the room [m]."""
    return posture("above", forward=x - CAMERA_FORWARD, lateral=y, arm_lift=height - CAMERA_ABOVE_LIFT, **joints)
