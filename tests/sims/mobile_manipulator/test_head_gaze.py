"""Where the head looks, by its joints, against the simulator's camera."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.head_gaze import gaze_on_floor
from dense_vs.sims.mobile_manipulator.postures import posture
from dense_vs.sims.mobile_manipulator.world import MobileWorld


@pytest.fixture(scope="module")
def world():
    return MobileWorld(["Tuna"], seed=1, device="cpu")


@pytest.mark.parametrize("height", [0.0, 0.3])
@pytest.mark.parametrize(
    "joints",
    [
        {"head_tilt": -0.5},
        {"head_tilt": -0.9, "head_pan": 0.8},
        {"head_tilt": -0.3, "head_pan": -1.1, "forward": 0.4, "lateral": -0.7, "base_roll": 0.5},
    ],
)
def test_the_optical_axis_meets_the_floor_there(world, joints, height):
    q = posture("gaze", **joints)
    world.set_posture(q)
    pose = world.camera_pose("head")
    axis = pose[:3, 2]
    true = pose[:3, 3] + axis * (height - pose[2, 3]) / axis[2]
    np.testing.assert_allclose(gaze_on_floor(q, height), true[:2], atol=1e-3)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_head_that_looks_up(tilt):
    with pytest.raises(DenseVSError, match="looks down"):
        gaze_on_floor(posture("gaze", head_tilt=tilt))
