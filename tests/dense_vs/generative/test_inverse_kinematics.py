"""Joints from poses of the hand: they put it there, from starts near and far, by the DH table's chain."""

import numpy as np
import pytest

from dense_vs.generative.inference.inverse_kinematics import joints_of_pose


def hand_pose(model, joints):
    """The hand's motion from home (4, 4), by the DH table and not by the lines that the solver follows."""
    frames = model.denavit_hartenberg.frames(np.stack([model.parameters.home, joints]))[:, -1]
    return frames[1] @ np.linalg.inv(frames[0])


def test_joints_put_the_hand_where_it_should_be(ur5, model):
    rng = np.random.default_rng(3)
    for truth in ur5.unseen_joints[:10]:
        pose = hand_pose(model, truth)
        joints, left = joints_of_pose(model.parameters, pose, truth + rng.normal(0, 0.5, (6, 6)))
        assert left.min() < 1e-8
        for solved in joints[left < 1e-8]:
            np.testing.assert_allclose(hand_pose(model, solved), pose, atol=1e-6)


def test_a_start_nearby_leads_back(ur5, model):
    truth = ur5.unseen_joints[0]
    joints, left = joints_of_pose(model.parameters, hand_pose(model, truth), truth[None] + 0.02)
    assert left[0] < 1e-8
    assert joints[0] == pytest.approx(truth, abs=1e-5)


def test_a_start_that_is_there_already_does_not_end_the_others(ur5, model):
    truth = ur5.unseen_joints[0]
    pose = hand_pose(model, truth)
    (there,), _ = joints_of_pose(model.parameters, pose, truth[None] + 0.02)
    joints, left = joints_of_pose(model.parameters, pose, np.stack([there, truth + 0.02]))
    np.testing.assert_array_equal(joints[0], there)
    assert (left < 1e-8).all()


def test_a_pose_out_of_reach_says_how_far(model):
    far = np.eye(4)
    far[:3, 3] = 100 * np.linalg.norm(np.ptp(model.parameters.points, axis=0))
    joints, left = joints_of_pose(model.parameters, far, model.postures[:3])
    assert np.isfinite(joints).all()
    assert (left > 1).all()
