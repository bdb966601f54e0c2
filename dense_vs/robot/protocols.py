"""The two interfaces between this library and a robot: a camera and its joints.

Anything with these methods works; nothing needs to be inherited. ``dense_vs.sims`` implements them for
simulated robots, a user for a real one.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Camera(Protocol):
    """A camera that gives the newest image."""

    def read(self) -> tuple[np.ndarray, float]:
        """The next image, RGB uint8 ``(H, W, 3)`` or grey ``(H, W)``, and its time stamp [s].

        Blocks until there is one; the stamps increase and share their clock with :class:`Robot`'s.
        """
        ...


@runtime_checkable
class Robot(Protocol):
    """A robot that reports its joints and follows small changes of them."""

    @property
    def joint_names(self) -> Sequence[str]:
        """Names of the N joints, in the order of every joint vector."""
        ...

    def joints(self) -> tuple[np.ndarray, float]:
        """Joint positions ``(N,)`` [rad, m for a prismatic joint] and their time stamp [s]."""
        ...

    def command(self, delta: np.ndarray) -> None:
        """Change the joint targets by ``delta`` ``(N,)`` [rad]; returns without waiting for the motion."""
        ...
