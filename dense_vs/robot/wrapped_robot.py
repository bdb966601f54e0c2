"""A robot around another one: for what stands between a loop and a robot, to record it, stop it or let it fail."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dense_vs.checks import check_methods
from dense_vs.robot.protocols import Holding, JointUnits, Robot, Watched


class WrappedRobot:
    """Passes every member of a robot on, also those that a robot need not have; a subclass replaces what it changes.

    Args:
        robot: what everything is passed on to.

    Raises:
        DenseVSError: no robot.
    """

    def __init__(self, robot: Robot):
        check_methods("robot", robot, "joints", "command")
        self._robot = robot

    @property
    def joint_names(self) -> Sequence[str]:
        """Names of the robot's N joints."""
        return self._robot.joint_names

    @property
    def joint_limits(self) -> np.ndarray | None:
        """``(N, 2)`` the robot's limits, as it gives them [rad, m]."""
        return self._robot.joint_limits

    @property
    def joint_units(self) -> Sequence[str]:
        """Unit of each joint; ``"rad"`` where the robot does not say."""
        robot = self._robot
        return robot.joint_units if isinstance(robot, JointUnits) else ("rad",) * len(self.joint_names)

    @property
    def watchdog(self) -> Any:
        """What makes the robot hold when its program dies; None where it has none."""
        return self._robot.watchdog if isinstance(self._robot, Watched) else None

    def joints(self) -> tuple[np.ndarray, float]:
        """The robot's joint positions ``(N,)`` [rad, m] and their time stamp [s]."""
        return self._robot.joints()

    def command(self, delta: np.ndarray) -> None:
        """Pass a command ``(N,)`` on [rad, m]."""
        self._robot.command(delta)

    def hold(self) -> None:
        """Tell the robot to hold at once, where it can; from any thread."""
        if isinstance(self._robot, Holding):
            self._robot.hold()
