"""The mobile manipulator's world as the camera, robot and gripper that the algorithms know."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.sims.mobile_manipulator.world import OPENING, MobileWorld


class ManipulatorCamera:
    """Camera protocol: images of one of the two cameras.

    Args:
        world: what it sees.
        name: ``"head"`` or ``"grasp"``.
    """

    def __init__(self, world: MobileWorld, name: str):
        self.world, self.name = world, name

    def read(self) -> tuple[np.ndarray, float]:
        """Image (480, 640, 3) uint8 RGB and its time [s]."""
        return self.world.image(self.name), self.world.time


class ManipulatorRobot:
    """Robot protocol; a command is carried out before it returns, as discrete motions of VOS-VS section 4.2 are."""

    def __init__(self, world: MobileWorld, settle_frames: int = 6):
        self.world = world
        self.settle_frames = settle_frames

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The ten joints in the order of VOS-VS (1)."""
        return self.world.joint_names

    @property
    def joint_limits(self) -> np.ndarray:
        """(10, 2) lowest and highest position [rad, m]."""
        return self.world.joint_limits

    @property
    def joint_units(self) -> tuple[str, ...]:
        """``"rad"`` or ``"m"`` of each joint."""
        return self.world.joint_units

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions (10,) by the encoders [rad, m] and their time [s]."""
        return self.world.joints(), self.world.time

    def command(self, delta: Any) -> None:
        """Move the joint targets by delta (10,) and wait until the robot rests."""
        self.world.move(delta, settle_frames=self.settle_frames)


@dataclass(frozen=True)
class GripperReport:
    """Reading of the gripper's encoder after a command."""

    opening: float  # m
    jammed: bool  # it did not get where an empty gripper gets


class ManipulatorGripper:
    """The parallel gripper; fails to open where something holds its fingers."""

    def __init__(self, world: MobileWorld):
        self.world = world

    def open(self) -> GripperReport:
        """Open fully."""
        opening = self.world.set_gripper(OPENING)
        return GripperReport(opening, opening < 0.9 * OPENING)

    def close(self) -> GripperReport:
        """Close with the gripper's force on whatever is between the fingers."""
        opening = self.world.set_gripper(0.0, frames=30)
        return GripperReport(opening, opening > 0.98 * OPENING)
