"""The gate between a control law and a robot: every command of every loop goes through it.

What passes is finite, no longer than the largest step, ends inside the joint limits, and comes from an image and a
reading that are newer than those of the last motion and not old. Where that does not hold, a step of zero is sent.
On the live page a command passes :class:`dense_vs.live.gate.PageGate` after it.
"""

from typing import Any

import numpy as np

from dense_vs.arrays import real_vector
from dense_vs.checks import check_kind, check_methods, check_number, shown
from dense_vs.errors import DenseVSError
from dense_vs.robot.joint_group import JointGroup
from dense_vs.robot.per_joint import per_joint, stamp_of
from dense_vs.robot.protocols import Robot

MAX_AGE = 0.5  # s
MOST = 1e100  # rad, m
FOLLOWED = 0.1  # share of the way from the targets to the readings by which the targets are corrected a command


class CommandGate:
    """Sends joint steps of some of a robot's joints.

    Args:
        robot: gets a command for all its joints, zero for those outside of the group.
        group: the n joints in use, with their limits.
        max_step: largest step of a joint in one command, a number or ``(n,)`` [rad, m]; a longer command is shortened
            as a whole.
        max_age: age of an image or a reading from which on it is not acted on [s].

    Attributes:
        stopped: why the last command was a step of zero in place of what was asked for; empty where it was not.

    Raises:
        DenseVSError: no robot or group, a bound that is not a finite number above 0, or another number of them.
    """

    def __init__(self, robot: Robot, group: JointGroup, *, max_step: Any, max_age: float = MAX_AGE):
        check_methods("robot", robot, "command")
        self._robot, self.group = robot, check_kind("group", group, JointGroup)
        self.max_step = per_joint("max_step", max_step, len(group.names), above=1 / MOST)
        self.max_age = check_number("max_age", max_age, above=0)
        self.stopped = ""
        self.restart()

    def restart(self) -> None:
        """Forget what was sent, as after a pause in which someone else may have moved the robot."""
        self._targets: np.ndarray | None = None
        self._moved_on = -np.inf  # stamp of the image of the last motion

    def send(
        self,
        delta: Any,
        positions: Any,
        *,
        image_time: float | None = None,
        now: float | None = None,
        reading_time: float | None = None,
        stop: str = "",
    ) -> np.ndarray:
        """Send a joint step, or what of it may be sent; returns the step that was sent, ``(n,)``.

        Args:
            delta: ``(n,)`` [rad, m].
            positions: ``(n,)``, the newest joint positions that are believed.
            image_time: stamp of the image that the step was computed from [s]; None for a step that needs no image.
            now: the newest stamp that is known [s]; the larger of the other two unless given.
            reading_time: stamp of ``positions`` [s].
            stop: a reason not to move, where there is one.

        Raises:
            DenseVSError: not n finite numbers, a stamp that is no number, or a reason that is no text; nothing is sent
                then.
        """
        count = len(self.group.names)
        step = real_vector(delta, "command", (count,))
        q = real_vector(positions, "joint positions", (count,))
        image_time = None if image_time is None else stamp_of("image_time", image_time)
        now = None if now is None else stamp_of("now", now)
        reading_time = None if reading_time is None else stamp_of("reading_time", reading_time)
        if not isinstance(stop, str):
            raise DenseVSError(f"stop is {shown(stop)}; expected a reason, empty where there is none")
        self.stopped = stop or self._old(image_time, now, reading_time)
        if self.stopped:
            step = np.zeros(count)
        elif step.any() and image_time is not None:
            self._moved_on = image_time
        step = self._within(step, q)
        self._robot.command(self.group.spread(step))
        targets = q if self._targets is None else self._targets
        self._targets = targets + step + FOLLOWED * (q - targets)
        return step

    def bounded(self, step: Any, positions: Any) -> np.ndarray:
        """The step no longer than allowed and not beyond the limits, from where the joints are and were sent to.

        A joint outside its limits may come back, not go further out.

        Args:
            step: ``(n,)`` [rad, m].
            positions: ``(n,)`` [rad, m].

        Raises:
            DenseVSError: not n finite numbers.
        """
        count = len(self.group.names)
        return self._within(real_vector(step, "step", (count,)), real_vector(positions, "positions", (count,)))

    def _within(self, step: np.ndarray, positions: np.ndarray) -> np.ndarray:
        # Clipped first where a quotient could be no number: the largest step is nothing beside it.
        step = np.clip(step, -MOST, MOST)
        longest = float((np.abs(step) / self.max_step).max(initial=0.0))
        within = step / max(longest, 1.0)
        targets = positions if self._targets is None else self._targets
        low = np.minimum(self.group.limits[:, 0] - np.minimum(positions, targets), 0.0)
        high = np.maximum(self.group.limits[:, 1] - np.maximum(positions, targets), 0.0)
        return np.clip(np.clip(within, low, high), -self.max_step, self.max_step)

    def _old(self, image_time: float | None, now: float | None, reading_time: float | None) -> str:
        stamps = [stamp for stamp in (image_time, now, reading_time) if stamp is not None]
        if not np.isfinite(stamps).all():
            return "a time stamp is not finite"
        newest = max(stamps, default=0.0)
        if image_time is not None and image_time <= self._moved_on:
            return f"the image of {image_time:.3f} s was acted on before"
        for name, stamp in (("image", image_time), ("joint reading", reading_time)):
            if stamp is not None and newest - stamp > self.max_age:
                return f"the {name} is {newest - stamp:.3f} s old"
        return ""
