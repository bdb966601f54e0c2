"""Pairs of simulated images at a set speed, with their exact flow, the robot's mask and the band inside its outline."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.flow.estimator import to_gray
from dense_vs.sims import SimWorld

OUTLINE_MARGIN = 4  # px
SETTLING = 4  # frames after which the arm follows a constant velocity
PER_DIRECTION = 3


@dataclass(frozen=True)
class FlowPair:
    """Two images and the truth between them.

    Attributes:
        speed: asked for, the median over the robot's pixels [px per frame].
        previous, present: uint8 ``(H, W)``.
        flow: ``(H, W, 2)`` exact, at the present pixels [px].
        robot: bool ``(H, W)``.
        outline: the robot's pixels within 4 px of the background.
    """

    speed: float
    previous: np.ndarray
    present: np.ndarray
    flow: np.ndarray
    robot: np.ndarray
    outline: np.ndarray


def flow_pairs(robot: str, seed: int, speeds: list[float], height: int, width: int) -> Iterator[FlowPair]:
    """Pairs of one robot moving in random directions of joint space, forth and back, at each of the speeds."""
    world = SimWorld(robot, height=height, width=width, seed=seed)
    rng = np.random.default_rng([seed, 7])
    for speed in speeds:
        direction = rng.normal(size=len(world.joint_names))
        for sign in (1, -1):
            moving = np.linalg.norm(world.true_jacobian() @ direction, axis=2)[world.robot_mask()]
            step = sign * direction * speed / np.median(moving)
            for k in range(SETTLING + PER_DIRECTION):
                previous = to_gray(world.frame().rgb)
                world.step(step)
                if k >= SETTLING:
                    yield _pair(world, speed, previous)


def _pair(world: SimWorld, speed: float, previous: np.ndarray) -> FlowPair:
    robot = world.robot_mask()
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * OUTLINE_MARGIN + 1,) * 2)
    # The image border is no outline: the body goes on beyond it.
    inner = cv2.erode(robot.astype(np.uint8), disc, borderValue=1).astype(bool)
    return FlowPair(speed, previous, to_gray(world.frame().rgb), world.true_flow(), robot, robot & ~inner)
