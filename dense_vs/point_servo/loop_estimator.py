"""The estimator of a servo loop: made to fit the camera's images and the robot's joints, or checked that it does, and
what it takes from the camera.
"""

from typing import Any

from dense_vs.arrays import plain_array
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, DepthCamera


def loop_estimator(
    estimator: DenseJacobian | None, camera: Camera, image: Any, group: JointGroup, scale: float, **options: Any
) -> DenseJacobian:
    """The estimator as given, or one that fits.

    Args:
        estimator: as a user gives it.
        camera: gives the images.
        image: one of them.
        group: the joints.
        scale: factor on the images' size.
        options: of an estimator made here.

    Raises:
        DenseVSError: another number of joints, a scale out of (0, 1], no image, or depth with a camera that has none.
    """
    count = len(group.names)
    scale = check_number("scale", scale, above=0, most=1)
    if estimator is None:
        seen = plain_array(image, "the camera's image", "uint8 of shape (H, W, 3) or (H, W)")
        if seen.ndim < 2:
            raise DenseVSError(f"the camera's image has shape {seen.shape}; expected (H, W, 3) or (H, W)")
        height, width = (round(side * scale) for side in seen.shape[:2])
        estimator = DenseJacobian(height=height, width=width, joints=count, on_bad_flow="skip", **options)
    if estimator.options.joints != count:
        raise DenseVSError(
            f"estimator has {estimator.options.joints} joints; expected {count}: {', '.join(group.names)}"
        )
    if estimator.options.depth and not isinstance(camera, DepthCamera):
        raise DenseVSError(f"camera is a {type(camera).__name__} without depth(); expected a DepthCamera, or no depth")
    return estimator


def read_depth(camera: Any, estimator: DenseJacobian) -> Any:
    """Depth image of the image that a camera gave last, for an estimator with depth; else None."""
    return camera.depth() if estimator.options.depth else None
