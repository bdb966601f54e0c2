"""What a camera or a robot gives with its time stamp, checked before anything is made of it."""

from typing import Any

from dense_vs.arrays import plain_array
from dense_vs.checks import shown
from dense_vs.errors import DenseVSError
from dense_vs.robot.protocols import Camera, Robot


def read_image(camera: Camera) -> tuple[Any, float]:
    """A camera's next image, as it is, and its time stamp [s], which may be anything that is a number.

    Raises:
        DenseVSError: it gives something else.
    """
    return _stamped(camera.read(), "camera.read()", "an image and its time stamp [s]")


def read_joints(robot: Robot) -> tuple[Any, float]:
    """A robot's joint positions, as they are, and their time stamp [s], which may be anything that is a number.

    Raises:
        DenseVSError: it gives something else.
    """
    return _stamped(robot.joints(), "robot.joints()", "joint positions (N,) and their time stamp [s]")


def _stamped(given: Any, source: str, expected: str) -> tuple[Any, float]:
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise DenseVSError(f"{source} gave {shown(given)}; expected {expected}")
    value, stamp = given
    number = plain_array(stamp, f"the time stamp of {source}", "a number [s]")
    if number.shape or number.dtype.kind not in "iuf":
        raise DenseVSError(f"{source} gave the time stamp {shown(stamp)}; expected a number [s]")
    return value, float(number)
