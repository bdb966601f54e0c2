"""Where on the floor the mobile manipulator's head looks, from its own joints: kinematics that every robot knows of its
head; nothing of it is calibrated against an image."""

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.model import JOINTS

# As in the model: the pan axis from the base's, the tilt axis over it, the camera before and over that [m].
NECK = np.array([-0.02, 0.0, 1.1])
TILT_AXIS = np.array([0.0, 0.0, 0.08])
CAMERA = np.array([0.09, 0.0, 0.05])


def gaze_on_floor(q: np.ndarray, height: float = 0.0) -> np.ndarray:
    """Point (2,) [m] in the frame of the base's odometry at which the head's optical axis meets a height.

    Args:
        q: joint positions (10,).
        height: over the floor [m].

    Raises:
        DenseVSError: the head does not look down.
    """
    value = dict(zip(JOINTS, np.asarray(q, dtype=float), strict=True))
    tilt = value["head_tilt"]  # up is positive
    turn = value["base_roll"]
    pitch = np.array([[np.cos(tilt), 0, -np.sin(tilt)], [0, 1, 0], [np.sin(tilt), 0, np.cos(tilt)]])
    base = np.array([value["base_forward"], value["base_lateral"], 0.0])
    eye = base + _yaw(turn) @ (NECK + _yaw(value["head_pan"]) @ (TILT_AXIS + pitch @ CAMERA))
    ray = _yaw(turn + value["head_pan"]) @ pitch @ np.array([1.0, 0.0, 0.0])
    if ray[2] > -1e-3:
        raise DenseVSError(f"head_tilt is {tilt:.3f} rad; expected one that looks down")
    return (eye + ray * (height - eye[2]) / ray[2])[:2]


def _yaw(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
