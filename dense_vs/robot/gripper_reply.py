"""What a gripper reports after a command, checked before anything is made of it."""

from typing import Any

from dense_vs.checks import check_flag, check_number, shown
from dense_vs.errors import DenseVSError
from dense_vs.robot.protocols import Gripper, GripperState


def open_gripper(gripper: Gripper) -> GripperState:
    """Open a gripper; what it reports.

    Raises:
        DenseVSError: it reports no opening [m], or not whether it jammed.
    """
    return _state(gripper.open(), "gripper.open()")


def close_gripper(gripper: Gripper) -> GripperState:
    """Close a gripper; otherwise as :func:`open_gripper`."""
    return _state(gripper.close(), "gripper.close()")


def _state(given: Any, source: str) -> GripperState:
    if not (hasattr(given, "opening") and hasattr(given, "jammed")):
        raise DenseVSError(f"{source} gave {shown(given)}; expected a state with opening [m] and jammed")
    check_number(f"{source}.opening", given.opening)
    check_flag(f"{source}.jammed", given.jammed)
    return given
