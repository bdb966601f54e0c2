"""Defaults are those documented, and limits that only one side has."""

import inspect

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.depth.region_shape import MAX_REGIONS, mask_regions
from dense_vs.depth.scale_posterior import ScaleModel
from dense_vs.grasp import GripperModel
from dense_vs.live.reachability import reason
from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden
from dense_vs.mask_servo.loop import MaskServo
from dense_vs.pipeline.recorded import RecordedEstimate
from dense_vs.robot.babbling import BabblingOptions


def defaults(made):
    return {
        name: one.default for name, one in inspect.signature(made).parameters.items() if one.default is not one.empty
    }


def test_the_servo_s_and_the_update_s_defaults():
    servo = defaults(MaskServo)
    assert (servo["gain"], servo["max_step"], servo["max_image_step"], servo["tolerance"]) == (1.0, 0.15, 60.0, 5.0)
    assert (servo["patience"], servo["stalled"]) == (3, 4)
    update = defaults(HadamardBroyden)
    assert (update["alpha"], update["min_cosine"]) == (0.1, 0.05)


def test_the_defaults_of_babbling_and_of_recordings():
    babbling = defaults(BabblingOptions)
    assert (babbling["amplitude"], babbling["time_constant"], babbling["max_flow"]) == (0.15, 0.4, 4.0)
    assert babbling["frame_time"] == pytest.approx(1 / 30)
    assert babbling["wide_amplitude"] is None
    assert defaults(RecordedEstimate)["smoothing"] == 0.065


def test_the_defaults_of_what_is_assumed_of_a_scale():
    assert defaults(ScaleModel) == {
        "pixel_noise": 0.3,
        "relative_noise": 0.01,
        "solidity": 0.3,
        "exact": 0.3,
        "grown": 1.5,
        "grown_spread": 2.2,
        "log_distance": 1.0,
        "outlier_degrees": 4.0,
        "lengths": None,
    }


def test_of_a_view_the_largest_regions_are_kept():
    mask = np.zeros((1, 40, 200), bool)
    for k in range(30):
        mask[0, 1 : 3 + k, 6 * k : 6 * k + 3] = True
    regions = mask_regions(mask)[0]
    assert len(regions) == MAX_REGIONS == 24
    assert [one.area for one in regions] == sorted((one.area for one in regions), reverse=True)
    assert regions[-1].area == 3 * (2 + 6)


@pytest.mark.parametrize(("limits", "q", "held"), [((-np.inf, 1.0), 0.995, False), ((-np.inf, 1.0), 1.0, True),
                                                   ((-1.0, np.inf), 5.0, False)])  # fmt: skip
def test_a_joint_with_one_limit_has_no_range(limits, q, held):
    J = np.array([[100.0, 0.0], [0.0, 80.0]])
    said = reason(J, np.array([30.0, 0.0]), np.array([q, 0.0]), np.array([limits, [-9.0, 9.0]]), 15.0)
    assert said.startswith("joint limit: joint 1") == held


@pytest.mark.parametrize("seed", range(20))
def test_every_rotation_is_one_for_the_gripper(seed):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    gripper = GripperModel(opening=0.1, width=0.02, thickness=0.01, length=0.03, T_camera_hand=pose)
    np.testing.assert_array_equal(gripper.T_camera_hand, pose)
