"""A simulated robot goes to a posture, and rests there."""

import numpy as np

from dense_vs.sims import SimWorld

LARGEST_STEP = 0.03  # rad a frame
NEAR = 0.005  # rad of every joint, from which on it is there
MOST_FRAMES = 400
STALLED = 15  # frames in which it comes no nearer
RESTING = 3  # frames until late joint readings, too, are those of a robot that stands


def go_to(world: SimWorld, q: np.ndarray) -> None:
    """Move there, at most 0.03 rad a frame; a posture to which it comes no nearer is given up."""
    nearest, without = np.inf, 0
    for _ in range(MOST_FRAMES):
        off = q - world.joints()[0]
        if np.abs(off).max() < NEAR:
            return
        left = float(np.abs(off).sum())
        without = 0 if left < nearest - NEAR else without + 1
        nearest = min(nearest, left)
        if without == STALLED:
            return
        world.step(np.clip(off, -LARGEST_STEP, LARGEST_STEP))


def rest(world: SimWorld) -> None:
    """Stand still until the joint readings say where the robot is, late ones too."""
    still = np.zeros(len(world.joint_names))
    for _ in range(RESTING):
        world.step(still)
