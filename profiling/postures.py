"""A simulated robot goes to a posture."""

import numpy as np

from dense_vs.sims import SimWorld

LARGEST_STEP = 0.03  # rad a frame
NEAR = 0.005  # rad of every joint, from which on it is there
MOST_FRAMES = 400


def go_to(world: SimWorld, q: np.ndarray) -> None:
    """Move there, at most 0.03 rad a frame; a posture that is not reached is given up."""
    for _ in range(MOST_FRAMES):
        off = q - world.joints()[0]
        if np.abs(off).max() < NEAR:
            return
        world.step(np.clip(off, -LARGEST_STEP, LARGEST_STEP))
