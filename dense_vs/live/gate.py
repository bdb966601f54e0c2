"""The page's gate: behind a loop's :class:`dense_vs.robot.CommandGate` the last thing that a command passes before the
robot, closed unless everything allows motion.

Any thread may close it, and a command that was computed before then goes no further: it becomes a zero step. So a stop
takes effect within the frame that is being worked on. It also ends what was asked for before it and has not begun yet.
Opening takes somebody in control; a speed limit and the joint limits hold for every command that passes.
"""

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.protocols import Robot
from dense_vs.robot.wrapped_robot import WrappedRobot

DEFAULT_SPEED = 1.0  # rad/s
SLIDING_SHARE = 0.25  # m/s of a sliding joint for every rad/s of a turning one
LONGEST_STEP = 0.1  # s; a frame that took longer allows no larger step
PRESS_SECONDS = 0.4  # a press of the dead-man's key counts for so long


class PageGate:
    """Decides what reaches the robot.

    Args:
        max_speed: of a turning joint [rad/s]; a sliding one has a quarter of the number [m/s].
        clock: seconds, for the dead-man's key.

    Attributes:
        reason: why it is closed, for the user; "" where it is open.
        stops: how often it was told to stop, while it was closed too.
        dead_man: whether commands pass only while :meth:`press` is called again and again.
    """

    def __init__(self, max_speed: float = DEFAULT_SPEED, *, clock: Callable[[], float] = time.monotonic):
        self._lock = threading.Lock()
        self._clock = clock
        self._open = False
        self.stops = 0
        self._pressed_until = -np.inf
        self._max_speed = check_number("max_speed", max_speed, above=0)
        self.dead_man = False
        self.reason = "not started"

    @property
    def max_speed(self) -> float:
        """Largest speed of a turning joint [rad/s]."""
        return self._max_speed

    @max_speed.setter
    def max_speed(self, value: float) -> None:
        self._max_speed = check_number("max_speed", value, above=0)

    @property
    def sliding_speed(self) -> float:
        """Largest speed of a sliding joint [m/s]."""
        return SLIDING_SHARE * self._max_speed

    @property
    def open(self) -> bool:
        """Whether motion is allowed, a dead-man's key aside."""
        return self._open

    @property
    def passing(self) -> bool:
        """Whether a command would pass now."""
        return self._open and (not self.dead_man or self._clock() < self._pressed_until)

    def allow(self, stops: int | None = None) -> None:
        """Open: somebody in control asked for motion.

        Args:
            stops: :attr:`stops` when it was asked for; None where that is now.

        Raises:
            DenseVSError: a stop came after it was asked for; stays closed.
        """
        with self._lock:
            if stops is not None and stops != self.stops:
                raise DenseVSError("a stop came after the motion was asked for; expected it to be asked for again")
            self._open, self.reason = True, ""

    def close(self, reason: str, *, done: bool = False) -> bool:
        """Stop commands from now on; whether it was open. The first reason stays.

        Args:
            reason: for the user.
            done: whether a motion merely came to its end, so that one that was asked for meanwhile may begin.
        """
        with self._lock:
            was_open, self._open = self._open, False
            self.stops += not done
            if was_open or not self.reason:
                self.reason = reason
            return was_open

    def press(self) -> None:
        """The dead-man's key is down now; counts for :data:`PRESS_SECONDS`."""
        self._pressed_until = self._clock() + PRESS_SECONDS

    def release(self) -> None:
        """The dead-man's key is up."""
        self._pressed_until = -np.inf

    def largest_step(self, seconds: float, units: Sequence[str]) -> np.ndarray:
        """Of each joint, by its unit, in a command that comes so long after the last ``(N,)`` [rad, m]."""
        speeds = [self.sliding_speed if unit == "m" else self._max_speed for unit in units]
        return np.array(speeds) * min(seconds, LONGEST_STEP)

    def passed(self, delta: np.ndarray, positions: np.ndarray, group: JointGroup, seconds: float) -> np.ndarray:
        """What of a joint step ``(N,)`` reaches the robot.

        Args:
            delta: the step [rad, m].
            positions: ``(N,)`` where the joints are.
            group: the joints' units and limits; a joint beyond its limit may come back, not go further out.
            seconds: since the last command, for the speed limit.
        """
        if not self.passing or not np.isfinite(delta).all():
            return np.zeros(len(delta))
        step = delta / max(1.0, float((np.abs(delta) / self.largest_step(seconds, group.units)).max(initial=0.0)))
        room = group.limits - positions[:, None]
        return np.clip(step, np.minimum(room[:, 0], 0.0), np.maximum(room[:, 1], 0.0))


class GatedRobot(WrappedRobot):
    """A robot behind a gate: readings pass, commands as the gate allows.

    Args:
        robot: the robot.
        gate: its gate.

    Attributes:
        last_command: ``(N,)`` what was passed to the robot last [rad, m].
        frame_seconds: time between commands, for the speed limit [s]; the session keeps it.
        reading_time: stamp of the last joint reading [s].
    """

    def __init__(self, robot: Robot, gate: PageGate):
        super().__init__(robot)
        self._gate = gate
        self._group = JointGroup.of_robot(robot)
        self._positions = np.zeros(self._group.total)
        self.last_command = np.zeros(self._group.total)
        self.frame_seconds = 1 / 30
        self.reading_time = -np.inf

    @property
    def largest_step(self) -> np.ndarray:
        """``(N,)`` what the gate lets each joint go in the next command [rad, m]."""
        return self._gate.largest_step(self.frame_seconds, self._group.units)

    def joints(self) -> tuple[np.ndarray, float]:
        """The robot's joints."""
        positions, time = super().joints()
        self._positions, self.reading_time = np.asarray(positions, dtype=np.float64), float(time)
        return positions, time

    def command(self, delta: np.ndarray) -> None:
        """Pass on what the gate allows; a robot that is stopped gets a zero step, which holds it."""
        step = self._gate.passed(np.asarray(delta), self._positions, self._group, self.frame_seconds)
        self.last_command = step
        super().command(step)
