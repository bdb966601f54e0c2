"""What a learnt J+ should be: joints of a simulated robot moved a little, centroids by the renderer's ids.

Truth for scores; nothing of it reaches the robot.
"""

import numpy as np

from dense_vs.sims.mobile_manipulator.model import JOINTS
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.configurations import Configuration

_STEP = {"arm_lift": 0.01, "base_forward": 0.01, "base_lateral": 0.01}  # m; others 0.02 rad


def true_pinv(world: MobileWorld, one: Configuration, name: str) -> np.ndarray:
    """dq_i/ds_j ``(n, 2)`` where H is 1 and 0 elsewhere, of the joint alone, at the present posture [rad/px, m/px].

    ``nan`` where the object is not seen.
    """
    start = world.true_joints()
    pinv = np.zeros(one.coupling.shape)
    for row, joint in enumerate(one.joints):
        column = int(np.argmax(one.coupling[row]))
        step = _STEP.get(joint, 0.02)
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
    rows, columns = np.nonzero(world.true_mask(camera, name))
    if not rows.size:
        return np.full(2, np.nan)
    return np.array([columns.mean(), rows.mean()])
