"""Frames of a simulated robot, rendered before anything is timed, and a camera and robot that play them again."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dense_vs import Babbling
from dense_vs.sims import SimWorld


@dataclass(frozen=True)
class Recording:
    """A robot's babbling as it was seen.

    Attributes:
        rgb: ``(frames, H, W, 3)`` uint8.
        times: ``(frames,)`` [s].
        positions: ``(frames, N)`` [rad].
        tip: ``(frames, 2)``, where the robot's tip is [px].
        joint_names: N names.
        joint_limits: ``(N, 2)`` [rad].
    """

    rgb: np.ndarray
    times: np.ndarray
    positions: np.ndarray
    tip: np.ndarray
    joint_names: Sequence[str]
    joint_limits: np.ndarray


def record(
    robot: str,
    height: int,
    width: int,
    *,
    frames: int,
    seed: int,
    joints: int | None = None,
    then: tuple[int, float] | None = None,
) -> Recording:
    """Let a simulated robot babble at up to 4 px a frame; with its first ``joints``, all unless given.

    ``then`` is the frame from which on it moves at another pace, and that pace [px per frame].
    """
    names = None if joints is None else SimWorld(robot, height=8, width=8).joint_names[:joints]
    world = SimWorld(robot, height=height, width=width, seed=seed, joints=names)
    babbling = Babbling(len(world.joint_names), seed=seed)
    rgb, times, positions, tips = [], [], [], []
    flow = None
    for k in range(frames):
        if then is not None and k == then[0]:
            babbling.options = replace(babbling.options, max_flow=then[1])
        world.step(babbling.step(flow))
        image = world.frame()
        flow = world.true_flow()
        rgb.append(image.rgb)
        times.append(image.time)
        positions.append(world.joints()[0])
        tips.append(world.project("tip"))
    return Recording(
        np.stack(rgb),
        np.array(times),
        np.stack(positions),
        np.stack(tips),
        world.joint_names,
        world.joint_limits,
    )


def image_size(text: str) -> tuple[int, int]:
    """(width, height) from ``"320x240"``."""
    width, height = (int(side) for side in text.lower().split("x"))
    return width, height


class Replay:
    """A recording as camera and robot in one; commands are taken and not followed."""

    def __init__(self, recording: Recording):
        self._recording = recording
        self._next = 0
        self.joint_names = recording.joint_names
        self.joint_limits = recording.joint_limits

    def read(self) -> tuple[np.ndarray, float]:
        """The next image and its time [s]."""
        k = self._next
        self._next += 1
        return self._recording.rgb[k], float(self._recording.times[k])

    def joints(self) -> tuple[np.ndarray, float]:
        """Joint positions at the last image and their time [s]."""
        k = self._next - 1
        return self._recording.positions[k], float(self._recording.times[k])

    def command(self, delta: np.ndarray) -> None:
        """Take a joint step."""
