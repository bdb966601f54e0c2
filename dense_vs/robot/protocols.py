"""The interfaces between this library and a robot: a camera, its joints and a gripper.

Anything with these members works; nothing needs to be inherited. ``dense_vs.sims`` implements them for
simulated robots, a user for a real one. A robot around another one is a :class:`dense_vs.robot.WrappedRobot`.
"""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Camera(Protocol):
    """A camera that gives the newest image."""

    def read(self) -> tuple[np.ndarray, float]:
        """The next image, RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``, and its time stamp [s].

        Blocks until there is one; the stamps increase and share their clock with :class:`Robot`'s.
        """
        ...


@runtime_checkable
class DepthCamera(Camera, Protocol):
    """A camera that gives depth images of the same pixels, as an RGB-D camera whose depth is aligned to its color."""

    def depth(self) -> np.ndarray:
        """Depth along the optical axis in the image that :meth:`read` gave last, floating point ``(H, W)`` [m].

        0 or NaN where it is not known.
        """
        ...


@runtime_checkable
class Robot(Protocol):
    """A robot that reports its joints and follows small changes of them."""

    @property
    def joint_names(self) -> Sequence[str]:
        """Names of the N joints, in the order of every joint vector."""
        ...

    @property
    def joint_limits(self) -> np.ndarray | None:
        """``(N, 2)`` least and greatest position [rad, m for a prismatic joint], -inf and inf for a joint without.

        Commands keep them. None where the robot has no limits or keeps its own.
        """
        ...

    def joints(self) -> tuple[np.ndarray, float]:
        """Joint positions ``(N,)`` [rad, m for a prismatic joint] and their time stamp [s]."""
        ...

    def command(self, delta: np.ndarray) -> None:
        """Change the joint targets by ``delta`` ``(N,)`` [rad, m]; returns without waiting for the motion."""
        ...


@runtime_checkable
class JointUnits(Protocol):
    """What a :class:`Robot` may have besides: the units of its joints. All are taken for rad without."""

    @property
    def joint_units(self) -> Sequence[str]:
        """Unit of each of the N joints: ``"rad"``, or ``"m"`` for a prismatic joint."""
        ...


@runtime_checkable
class Holding(Protocol):
    """What a :class:`Robot` may have besides: a way to stop it between commands."""

    def hold(self) -> None:
        """Stop at once and hold; called from any thread."""
        ...


@runtime_checkable
class Watched(Protocol):
    """What a :class:`Robot` may have besides: how another process makes it hold when its program dies."""

    @property
    def watchdog(self) -> Any:
        """A :class:`dense_vs.drivers.watchdog.Hold`; None for a robot that holds by itself when commands stop."""
        ...


class GripperState(Protocol):
    """What a gripper reports after a command."""

    @property
    def opening(self) -> float:
        """Distance between the fingertips [m]."""
        ...

    @property
    def jammed(self) -> bool:
        """Whether it stopped short of where it gets when nothing is in its way."""
        ...


@runtime_checkable
class Gripper(Protocol):
    """A parallel gripper; both commands return when the fingers have stopped."""

    def open(self) -> GripperState:
        """Open fully."""
        ...

    def close(self) -> GripperState:
        """Close on whatever is between the fingers."""
        ...
