"""Where the camera stops to grasp: VOS-VS (21), z_camera,grasp = z_object + z_gripper."""

import numpy as np

from dense_vs.errors import DenseVSError


def grasp_camera_position(z_object: float, z_gripper: float) -> float:
    """Camera position z_camera,grasp [m] at which the closed fingertips are at the object, (21).

    Args:
        z_object: the object's estimated position along the optical axis [m], on the axis that z_camera is
            measured on: it grows from the object towards the camera, as in (17).
        z_gripper: camera's position minus that of the centre of the closed fingertips on the same axis [m], above 0
            where the fingertips are before the camera.

    Raises:
        DenseVSError: a value that is not finite, as an unobservable depth is.
    """
    for name, value in (("z_object", z_object), ("z_gripper", z_gripper)):
        if not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
            raise DenseVSError(f"{name} is {value!r}; expected a finite position [m]")
    return float(z_object) + float(z_gripper)
