"""Robots of LeRobot (SO-100, SO-101, Koch and others) behind the ``Robot`` protocol, without their calibration.

LeRobot's own ``get_observation`` and ``send_action`` need the arm to be calibrated. dense-vs needs no zero and no
range, only how far a joint moved, so a motor bus is read and written in its raw counts (``normalize=False``), as turns
of 4096 counts: rad, counted from where the joint stood at the start. A robot without a motor bus is used by its
observations and actions, in degrees.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.checks import check_number
from dense_vs.drivers.watchdog import Hold
from dense_vs.errors import DenseVSError

COUNTS = 4096  # of a turn, of the Feetech STS3215 and the Dynamixel XL330 and XL430
POSITION = ".pos"  # ends the names of joints in LeRobot's observations
MOST_DROPPED = 5  # readings of a bus, one after the other
LEAD = 0.2  # rad; how far a goal may run ahead of where the joint is


class LeRobotRobot:
    """A connected robot of LeRobot. Stamps are ``time.monotonic()``.

    Not run on hardware here: tested with a simulated SO-101 that speaks the interface of LeRobot 0.4.

    Args:
        robot: a connected ``lerobot.robots.Robot``.
        joints: names of the motors to use; all but grippers unless given.
        reach: how far a joint may go from where it stands now, to either side [rad]; the limits where the counts'
            own ends are not nearer.
        clock: of the stamps [s].
        watchdog: how a process apart makes it hold.

    Raises:
        DenseVSError: a robot that is not connected, an unknown motor, or an option out of range.
    """

    def __init__(
        self,
        robot: Any,
        *,
        joints: Sequence[str] | None = None,
        reach: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        watchdog: Hold | None = None,
    ):
        if not robot.is_connected:
            raise DenseVSError(f"{robot} is not connected; expected connect(calibrate=False) first")
        check_number("reach", reach, above=0)
        self._robot, self._clock, self.watchdog = robot, clock, watchdog
        self._bus = getattr(robot, "bus", None)
        if self._bus is not None:
            every = tuple(self._bus.motors)
            self._unit = 2 * np.pi / COUNTS
        else:
            every = tuple(name.removesuffix(POSITION) for name in robot.action_features if name.endswith(POSITION))
            self._unit = np.pi / 180
        chosen = tuple(name for name in every if "gripper" not in name) if joints is None else tuple(joints)
        unknown = [name for name in chosen if name not in every]
        if unknown or not chosen:
            raise DenseVSError(f"joints are {', '.join(chosen) or 'none'}; expected some of {', '.join(every)}")
        self.joint_names = chosen
        self._dropped = 0
        self._raw = self._read()
        self._zero = self._raw.copy()
        self._goal = self._raw.copy()
        self._last: tuple[np.ndarray, float] = (np.zeros(len(chosen)), clock())
        low, high = np.full(len(chosen), -reach), np.full(len(chosen), reach)
        if self._bus is not None:  # a count never goes past its ends: there the motor would turn all the way round
            low = np.maximum(low, -self._zero * self._unit)
            high = np.minimum(high, (COUNTS - 1 - self._zero) * self._unit)
        self.joint_limits = np.stack([np.minimum(low, -1e-3), np.maximum(high, 1e-3)], axis=1)

    @classmethod
    def connect(cls, kind: str, port: str, **options: Any) -> "LeRobotRobot":
        """Connect a robot by LeRobot's name of it, without calibration.

        LeRobot configures the motors then and lets go of them for a moment: let the arm rest on something.

        Args:
            kind: as ``"so101_follower"`` or ``"koch_follower"``.
            port: its serial port.
            options: of :class:`LeRobotRobot`.

        Raises:
            DenseVSError: an unknown name, or a robot that cannot be connected.
            ImportError: LeRobot is not installed.
        """
        robot = made(kind, port)
        try:
            robot.connect(calibrate=False)
        except (ConnectionError, RuntimeError, OSError, ValueError) as error:
            raise DenseVSError(f"cannot connect {kind} at {port}: {error}") from error
        hold = Hold("dense_vs.drivers.lerobot_robot:hold", {"kind": kind, "port": port})
        return cls(robot, watchdog=hold, **options)

    def joints(self) -> tuple[np.ndarray, float]:
        """Positions ``(N,)`` [rad], counted from the start, and when they were read [s].

        A reading that the bus drops gives the last one again, with its old stamp.

        Raises:
            DenseVSError: several were dropped one after the other.
        """
        begin = self._clock()
        try:
            self._raw = self._read()
        except (ConnectionError, RuntimeError, OSError) as error:
            self._dropped += 1
            if self._dropped > MOST_DROPPED:
                raise DenseVSError(f"the bus dropped {self._dropped} readings one after the other: {error}") from error
            return self._last[0].copy(), self._last[1]
        self._dropped = 0
        self._last = (self._raw - self._zero) * self._unit, 0.5 * (begin + self._clock())
        return self._last[0].copy(), self._last[1]

    def command(self, delta: np.ndarray) -> None:
        """Change the goals by ``delta`` ``(N,)`` [rad]; a goal never runs far ahead of its joint.

        Raises:
            DenseVSError: not N finite numbers, or the bus does not take them.
        """
        step = real_vector(np.asarray(delta, dtype=np.float64), "delta", (len(self.joint_names),))
        if not step.any():
            return  # the motors hold their last goals
        ahead = LEAD / self._unit
        goal = np.clip(self._goal + step / self._unit, self._raw - ahead, self._raw + ahead)
        low, high = (self._zero + limit / self._unit for limit in self.joint_limits.T)
        self._goal = np.clip(goal, low, high)
        self._write(self._goal)

    def hold(self) -> None:
        """Make where the joints are their goals."""
        self._goal = self._raw.copy()
        self._write(self._goal)

    def disconnect(self) -> None:
        """Give the robot back; LeRobot's own settings say whether the motors let go."""
        self._robot.disconnect()

    def _read(self) -> np.ndarray:
        if self._bus is not None:
            found = self._bus.sync_read("Present_Position", list(self.joint_names), normalize=False)
        else:
            seen = self._robot.get_observation()
            found = {name: seen[name + POSITION] for name in self.joint_names}
        return np.array([found[name] for name in self.joint_names], dtype=np.float64)

    def _write(self, goal: np.ndarray) -> None:
        named = dict(zip(self.joint_names, goal.tolist(), strict=True))
        try:
            if self._bus is not None:
                counts = {name: round(value) for name, value in named.items()}
                self._bus.sync_write("Goal_Position", counts, normalize=False)
            else:
                self._robot.send_action({name + POSITION: value for name, value in named.items()})
        except (ConnectionError, RuntimeError, OSError) as error:
            raise DenseVSError(f"the robot does not take a command: {error}") from error


def made(kind: str, port: str) -> Any:
    """A robot of LeRobot that is not connected yet.

    Raises:
        DenseVSError: an unknown name.
        ImportError: LeRobot is not installed.
    """
    from importlib import import_module
    from pkgutil import iter_modules

    robots = import_module("lerobot.robots")
    for found in iter_modules(robots.__path__):
        if found.ispkg and (kind.startswith(found.name) or found.name.split("_")[0] == kind[:2]):
            import_module(f"lerobot.robots.{found.name}")  # registers its configurations
    known = robots.RobotConfig.get_known_choices()
    if kind not in known:
        raise DenseVSError(f"robot is {kind!r}; expected one of {', '.join(sorted(known)) or 'those of LeRobot'}")
    # The motors keep holding when the program ends; an arm that lets go falls.
    config = known[kind](port=port, disable_torque_on_disconnect=False)
    return import_module("lerobot.robots.utils").make_robot_from_config(config)


def hold(kind: str, port: str) -> None:
    """Open the bus anew and make where the joints are their goals; for the watchdog."""
    robot = made(kind, port)
    bus = getattr(robot, "bus", None)
    if bus is None:
        robot.connect(calibrate=False)
        LeRobotRobot(robot).hold()
        return
    # The bus alone: connecting the robot would configure its motors, and lets go of them meanwhile.
    bus.connect()
    try:
        bus.sync_write("Goal_Position", bus.sync_read("Present_Position", normalize=False), normalize=False)
    finally:
        bus.disconnect(disable_torque=False)
