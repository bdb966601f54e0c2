"""The parts of a servo loop: an estimator made to fit the camera's images and the robot's joints, or checked that it
does, as the other parts are, and what the loop takes from the camera.
"""

from typing import Any

from dense_vs.arrays import plain_array
from dense_vs.body import SelfBody
from dense_vs.checks import check_function, check_kind, check_number
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.scaled_size import scaled_size
from dense_vs.point_servo.law import VisualServo
from dense_vs.robot.babbling import WIDE_AMPLITUDE, Babbling
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Camera, DepthCamera
from dense_vs.robot.stamped import read_image


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
        DenseVSError: no estimator, another number of joints, a scale out of (0, 1], no image, or depth with a camera
            that has none.
    """
    count = len(group.names)
    scale = check_number("scale", scale, above=0, most=1)
    if estimator is None:
        seen = plain_array(image, "the camera's image", "uint8 of shape (H, W, 3) or (H, W)")
        if seen.ndim < 2:
            raise DenseVSError(f"the camera's image has shape {seen.shape}; expected (H, W, 3) or (H, W)")
        height, width = scaled_size(seen.shape[:2], scale)
        estimator = DenseJacobian(height=height, width=width, joints=count, on_bad_flow="skip", **options)
    check_kind("estimator", estimator, DenseJacobian)
    if estimator.options.joints != count:
        raise DenseVSError(
            f"estimator has {estimator.options.joints} joints; expected {count}: {', '.join(group.names)}"
        )
    if estimator.options.depth and not isinstance(camera, DepthCamera):
        raise DenseVSError(f"camera is a {type(camera).__name__} without depth(); expected a DepthCamera, or no depth")
    return estimator


def loop_babbling(joints: int, seed: int, command_period: float | None, learns_body: bool) -> Babbling:
    """The motion before J is known, where a user gives none.

    Args:
        joints: number of them.
        seed: of the motion.
        command_period: between commands [s]; None for one in every frame.
        learns_body: whether a body is learned from it, whose axes wider motion tells better.
    """
    pace = {} if command_period is None else {"frame_time": command_period}
    return Babbling(joints, seed=seed, wide_amplitude=WIDE_AMPLITUDE if learns_body else None, **pace)


def check_parts(
    joints: int, *, servo: Any = None, flow: Any = None, babbling: Any = None, body: Any = None, on_frame: Any = None
) -> None:
    """Refuse parts that a loop of so many joints cannot use; None is a part that it makes itself, or goes without.

    Raises:
        DenseVSError: a part of another kind, or of another number of joints.
    """
    kinds = (
        ("servo", servo, VisualServo),
        ("flow", flow, FlowEstimator),
        ("babbling", babbling, Babbling),
        ("body", body, SelfBody),
    )
    for name, part, kind in kinds:
        if part is not None:
            check_kind(name, part, kind)
    for name, part in (("servo", servo), ("babbling", babbling)):
        if part is not None and part.joints != joints:
            raise DenseVSError(f"{name} has {part.joints} joints; expected {joints}")
    check_function("on_frame", on_frame)


def read_camera(camera: Camera, estimator: DenseJacobian) -> tuple[Any, float, Any]:
    """The next image, its time stamp [s] and, for an estimator with depth, its depth image; else None.

    Raises:
        DenseVSError: the camera gives something else.
    """
    image, time = read_image(camera)
    return image, time, read_depth(camera, estimator)


def read_depth(camera: Any, estimator: DenseJacobian) -> Any:
    """Depth image of the image that a camera gave last, for an estimator with depth; else None."""
    return camera.depth() if estimator.options.depth else None
