"""Learning from noisy joints, from actions alone, and with a Cartesian controller."""

import numpy as np
import pytest
from arm_recordings import record
from reference_arms import link_poses
from scipy.spatial.transform import Rotation

from dense_vs.generative import GenerativeModel


def test_noisy_joints(ur5):
    noisy = ur5.joints + np.random.default_rng(0).normal(0, 0.01, ur5.joints.shape)
    plain = ur5.validation_error(GenerativeModel.fit(ur5.observations(joints=noisy)))
    model = GenerativeModel.fit(ur5.observations(joints=noisy), state="noisy")
    assert ur5.validation_error(model) < min(1.7, 0.9 * plain)
    assert model.report.joint_sigma == pytest.approx(0.01, rel=0.25)
    truth = np.abs(model.postures - ur5.joints).mean()
    assert truth < np.abs(noisy - ur5.joints).mean()


@pytest.mark.parametrize("noise", ["constant", "proportional"])
def test_actions_only(ur5, noise):
    steps = np.diff(ur5.joints, axis=0)
    spread = 0.01 if noise == "constant" else 0.02 * np.abs(steps)
    actions = steps + np.random.default_rng(1).normal(size=steps.shape) * spread
    model = GenerativeModel.fit(ur5.observations(joints=None, actions=actions), state="actions", noise=noise)
    offset = (model.postures - ur5.joints).mean(axis=0)  # images and actions leave it open
    assert ur5.validation_error(model, offset) < 1.4
    assert model.report.joint_sigma == pytest.approx(0.01 if noise == "constant" else 0.02, rel=0.3)


def cartesian_case(sigma, cameras=2):
    case = record("ur5", 1, 40, cameras=cameras)
    poses = np.array([link_poses(case.arm.table, q)[-1] for q in case.joints])
    rng = np.random.default_rng(2)
    noise = np.tile(np.eye(4), (len(poses), 1, 1))
    noise[:, :3, :3] = Rotation.from_euler("xyz", rng.normal(0, sigma, (len(poses), 3))).as_matrix()
    shift = rng.normal(0, sigma, (len(poses), 3))
    return case, poses, noise, shift


def move_error(case, model, exact=True):
    """Error [px] after one commanded transform, mean over targets."""
    errors = []
    for k in range(0, 20, 2):
        start, goal = (link_poses(case.arm.table, case.unseen_joints[k + i])[-1] for i in range(2))
        reached = model.command(case.unseen_pixels[k], case.unseen_pixels[k + 1]) @ start
        pixels = []
        for pose in (reached, goal):
            points = case.arm.features @ pose[:3, :3].T + pose[:3, 3]
            pixels.append(np.array([camera.pixels(points)[0] for camera in case.arm.cameras]))
        errors.append(np.linalg.norm(pixels[0] - pixels[1], axis=-1).mean())
    return float(np.median(errors))


@pytest.mark.parametrize("state", ["noisy", "actions"])
def test_cartesian_controller(state):
    case, poses, noise, shift = cartesian_case(0.01)
    if state == "noisy":
        given = poses.copy()
        given[:, :3, :3] = noise[:, :3, :3] @ poses[:, :3, :3]
        given[:, :3, 3] += shift
        changes = {"poses": given}
    else:
        given = poses[1:] @ np.linalg.inv(poses[:-1])
        given[:, :3, :3] = noise[1:, :3, :3] @ given[:, :3, :3]
        given[:, :3, 3] += shift[1:]
        changes = {"actions": given}
    obs = case.observations(joints=None, **changes)
    model = GenerativeModel.fit(obs, state=state, controller="cartesian")
    assert model.report.rms_px < 0.55
    np.testing.assert_allclose(model.report.pose_sigma, 0.01, rtol=0.35)
    assert move_error(case, model) < 2.5
    if state == "noisy":
        ahead = model.pixels(poses)
        assert np.nanmean(np.linalg.norm(ahead - case.pixels, axis=-1)) < 3.0


def test_cartesian_controller_with_exact_poses_and_one_camera():
    case, poses, _, _ = cartesian_case(0.0, cameras=1)
    model = GenerativeModel.fit(case.observations(joints=None, poses=poses), controller="cartesian")
    error = np.linalg.norm(model.pixels(poses) - case.pixels, axis=-1)
    assert np.nanmean(error) < 0.7
