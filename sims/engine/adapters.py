"""A simulated world as the camera and the robot that the algorithms know: they can't tell it from real ones."""

from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.sims.engine.scene import FRAME_SECONDS
from dense_vs.sims.engine.world import SimWorld


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

    Args:
        world: of one robot.
        command_seconds: time that a command is carried out in, with minimal jerk, as by a robot's own interpolator
            between commands that come only so often [s]; one frame where it is 0. Commands that overlap add up.

    Raises:
        DenseVSError: a world of several, as a robot is one; a time that is no number of seconds.
    """

    def __init__(self, world: SimWorld, *, command_seconds: float = 0.0):
        if world.shape[0] != 1:
            raise DenseVSError(f"the simulated world has {world.shape[0]} worlds; expected 1 for a robot")
        check_number("command_seconds", command_seconds, least=0)
        self.world = world
        frames = max(1, round(command_seconds / FRAME_SECONDS))
        s = np.arange(frames + 1) / frames
        self._shares = np.diff(10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]  # of a command, frame by frame
        self._pending = np.zeros((frames, len(world.joint_names)))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of every joint array."""
        return self.world.joint_names

    @property
    def joint_limits(self) -> np.ndarray:
        """(N, 2) lowest and highest position [rad or m]."""
        return self.world.joint_limits

    @property
    def joint_units(self) -> tuple[str, ...]:
        """``"rad"`` or ``"m"`` of each joint."""
        return self.world.joint_units

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions (N,) [rad or m] and their time [s]."""
        return self.world.joints()

    def command(self, delta: Any) -> None:
        """Move the joint targets by delta (N,) and let one frame pass."""
        step = real_vector(delta, "delta", (len(self.joint_names),))
        self._pending += self._shares * step
        self.world.step(self._pending[0])
        self._pending[:-1] = self._pending[1:]
        self._pending[-1] = 0.0
