"""The gripper of the mobile manipulator as its own camera sees it: known geometry, no calibration against joints."""

import numpy as np

from dense_vs.grasp import GripperModel
from dense_vs.grasp.loop import HandGeometry
from dense_vs.sims.mobile_manipulator.postures import FINGERTIP, GRIPPER_BEHIND, Z_GRIPPER
from dense_vs.sims.mobile_manipulator.world import HEIGHT, OPENING, WIDTH, MobileWorld
from dense_vs.sims.papers.vosvs.configurations import CENTRE, GRASP_CENTRE


def hand_geometry(world: MobileWorld) -> HandGeometry:
    """Its shape and place, and where in the image an object is under it."""
    # Hand x, the closing motion, is image y; hand y is image -x; z is the optical axis.
    pose = np.array(
        [[0, -1, 0, -GRIPPER_BEHIND], [1, 0, 0, 0], [0, 0, 1, Z_GRIPPER + FINGERTIP], [0, 0, 0, 1]], dtype=float
    )
    model = GripperModel(opening=OPENING, width=0.022, thickness=0.012, length=0.036, T_camera_hand=pose)
    return HandGeometry(Z_GRIPPER, GRASP_CENTRE, CENTRE, world.intrinsics("grasp"), model)


def fingers_in_view(world: MobileWorld) -> np.ndarray:
    """Where the open fingers stand in the grasp camera's image, bool (480, 640)."""
    hand = hand_geometry(world)
    return hand.model.finger_masks([0.0], hand.intrinsics, (HEIGHT, WIDTH))[0]
