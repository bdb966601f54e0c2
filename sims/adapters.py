"""A simulated world as the camera and the robot that the algorithms know: they can't tell it from real ones."""

from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.sims.world import SimWorld


class SimCamera:
    """Camera protocol: images of a world as it is now."""

    def __init__(self, world: SimWorld):
        self.world = world

    def read(self) -> tuple[np.ndarray, float]:
        """Image (H, W, 3) uint8 RGB and its time [s]."""
        frame = self.world.frame()
        return frame.rgb, frame.time


class SimRobot:
    """Robot protocol: commands advance the world by one camera frame.

    Raises:
        DenseVSError: a world of several; a robot is one.
    """

    def __init__(self, world: SimWorld):
        if world.shape[0] != 1:
            raise DenseVSError(f"the simulated world has {world.shape[0]} worlds; expected 1 for a robot")
        self.world = world

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of every joint array."""
        return self.world.joint_names

    @property
    def joint_limits(self) -> np.ndarray:
        """(N, 2) lowest and highest position [rad or m]."""
        return self.world.joint_limits

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions (N,) [rad or m] and their time [s]."""
        return self.world.joints()

    def command(self, delta: Any) -> None:
        """Move the joint targets by delta (N,) and let one frame pass."""
        self.world.step(delta)
