"""The true J+ by finite differences: each joint of the simulated robot moves a little, the renderer tells the centroid.

Truth for scores; nothing of it reaches the robot.
"""

import numpy as np

from dense_vs.segmentation.mask_features import mask_sums
from dense_vs.sims.mobile_manipulator.model import JOINTS
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import Configuration

_STEP = {"m": 0.01, "rad": 0.02}


def true_pinv(world: MobileWorld, one: Configuration, name: str) -> np.ndarray:
    """VOS-VS (13): dq_i/ds_j ``(n, 2)`` of each joint alone at the present posture [rad/px, m/px], 0 where H is 0.

    ``nan`` where the object is not seen.
    """
    start = world.true_joints()
    pinv = np.zeros(one.coupling.shape)
    for row, joint in enumerate(one.joints):
        column = int(np.argmax(one.coupling[row]))
        step = _STEP[world.joint_units[JOINTS.index(joint)]]
        places = []
        for sign in (-1, 1):
            q = start.copy()
            q[JOINTS.index(joint)] += sign * step
            world.set_posture(q, forget_odometry=False)
            places.append(true_centroid(world, one.camera, name)[column])
        pinv[row, column] = 2 * step / (places[1] - places[0])
    world.set_posture(start, forget_odometry=False)
    return pinv


def true_centroid(world: MobileWorld, camera: str, name: str) -> np.ndarray:
    """Centroid ``(2,)`` of the object's pixels [px]; nan where none is seen."""
    return mask_sums(world.true_mask(camera, name)).centroid
