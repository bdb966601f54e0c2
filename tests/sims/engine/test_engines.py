"""MuJoCo's C engine and MuJoCo-Warp hold the same world, and several worlds keep their leading dimension.

The only tests that step MuJoCo-Warp, whose kernels take a CPU half a minute to compile.
"""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimRobot, SimWorld

OPTIONS = {"device": "cpu", "height": 30, "width": 40, "seed": 3, "distractor": "behind"}
STEPS = np.random.default_rng(0).uniform(-0.03, 0.03, (3, 2, 4))
# float32 on the device; joint angles are below 1 rad.
JOINT_TOLERANCE = 1e-6  # rad


@pytest.fixture(scope="module")
def engines():
    one, two = SimWorld("arm", **OPTIONS), SimWorld("arm", worlds=2, **OPTIONS)
    histories = []
    for step in STEPS:
        one.step(step[0])
        two.step(step)
        histories.append((one.joint_history(), two.joint_history()))
    return one, two, histories


def test_same_trajectory(engines):
    one, two, histories = engines
    for (times, positions), (batch_times, batch_positions) in histories:
        assert batch_positions.shape == (2, *positions.shape)
        np.testing.assert_array_equal(batch_times, times)
        np.testing.assert_allclose(batch_positions[0], positions, atol=JOINT_TOLERANCE)
    np.testing.assert_allclose(two.joints()[0][0], one.joints()[0], atol=JOINT_TOLERANCE)


def test_same_image_and_truth(engines):
    one, two, _ = engines
    first, batch = one.frame(), two.frame()
    assert batch.rgb.shape == (2, 30, 40, 3)
    assert batch.depth.shape == batch.ids.shape == (2, 30, 40)
    same = batch.ids[0] == first.ids
    assert same.mean() > 0.99
    assert np.mean(np.abs(batch.rgb[0].astype(int) - first.rgb)[same] <= 2) > 0.99
    np.testing.assert_allclose(batch.depth[0][same], first.depth[same], atol=1e-3)
    np.testing.assert_allclose(two.true_flow()[0][same], one.true_flow()[same], atol=1e-3)
    scale = np.abs(one.true_jacobian()).max()
    np.testing.assert_allclose(two.true_jacobian()[0][same], one.true_jacobian()[same], atol=1e-3 * scale)
    np.testing.assert_array_equal(two.robot_mask()[0][same], one.robot_mask()[same])


def test_worlds_lead(engines):
    one, two, _ = engines
    assert two.true_flow().shape == (2, 30, 40, 2)
    assert two.true_jacobian().shape == (2, 30, 40, 2, 4)
    assert two.robot_mask().shape == (2, 30, 40)
    assert two.T_world_camera.shape == (2, 4, 4)
    assert two.joints()[0].shape == (2, 4)
    assert two.project("tip").shape == (2, 2)
    np.testing.assert_allclose(two.project("tip")[0], one.project("tip"), atol=1e-3)
    assert np.all(two.joints()[0][0] != two.joints()[0][1])
    assert np.any(two.frame().rgb[0] != two.frame().rgb[1])
    point = two.track_point(two.project("wrist"))
    assert two.visible(point).shape == (2,)
    np.testing.assert_allclose(two.project(point), two.project("wrist"), atol=1e-6)


def test_worlds_reset_and_refuse(engines):
    _, two, _ = engines
    for delta in (np.zeros((3, 4)), np.zeros(3), np.full((2, 4), np.nan)):
        with pytest.raises(DenseVSError, match="delta"):
            two.step(delta)
    with pytest.raises(DenseVSError, match="2 worlds"):
        SimRobot(two)
    two.reset()
    assert two.time == 0.0
    np.testing.assert_allclose(two.joints()[0][0], SimWorld("arm", **OPTIONS).joints()[0], atol=JOINT_TOLERANCE)
    two.step([0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(two.true_flow()[two.robot_mask()], 0.0, atol=1e-3)
