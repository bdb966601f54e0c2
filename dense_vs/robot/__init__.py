"""The interfaces to a robot: its camera, joints and gripper, joints by name, the gate of commands, and the motion by
which it learns.

May import: the ground (``errors``, ``checks``, ``arrays``, ``device``, ``files``) and kernels.
"""

from dense_vs.robot.babbling import Babbling, BabblingOptions
from dense_vs.robot.command_gate import CommandGate
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import (
    Camera,
    DepthCamera,
    Gripper,
    GripperState,
    Holding,
    JointUnits,
    Robot,
    Watched,
)
from dense_vs.robot.wrapped_robot import WrappedRobot

__all__ = [
    "Babbling",
    "BabblingOptions",
    "Camera",
    "CommandGate",
    "DepthCamera",
    "Gripper",
    "GripperState",
    "Holding",
    "JointGroup",
    "JointUnits",
    "Robot",
    "Watched",
    "WrappedRobot",
]
