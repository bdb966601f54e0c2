"""Where the camera stops to grasp: VOS-VS (21), z_camera,grasp = z_object + z_gripper."""

from dense_vs.checks import check_number


def grasp_camera_position(z_object: float, z_gripper: float) -> float:
    """Camera position z_camera,grasp [m] at which the closed fingertips are at the object, VOS-VS (21).

    Args:
        z_object: the object's estimated position along the optical axis [m], on the axis that z_camera is
            measured on: it grows from the object toward the camera, as in VOS-VS (17).
        z_gripper: camera's position minus that of the center of the closed fingertips on the same axis [m], above 0
            where the fingertips are before the camera.

    Raises:
        DenseVSError: a value that is not finite, as an unobservable depth is.
    """
    return check_number("z_object", z_object) + check_number("z_gripper", z_gripper)  # VOS-VS (21)
