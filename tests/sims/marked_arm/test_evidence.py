import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm.evidence import act, act_cartesian, draw_joints, observe
from dense_vs.sims.marked_arm.noise import REFERENCE_MOVE, NoisyController, noisy_pose


@pytest.fixture(scope="module")
def arm(trial):
    return trial.observed_arm()


def test_pixels_and_readings_have_the_noise_that_was_asked_for(arm):
    rng = np.random.default_rng(0)
    joints = draw_joints(arm, 200, rng)
    evidence = observe(arm, joints, rng, joint_noise=0.02)
    seen = evidence.observations.seen
    assert np.array_equal(seen, np.isfinite(evidence.truth.pixels[..., 0]))
    off = evidence.observations.pixels[seen] - evidence.truth.pixels[seen]
    np.testing.assert_allclose(off.std(axis=0), 0.5, rtol=0.06)
    np.testing.assert_allclose((evidence.observations.joints - joints).std(), 0.02, rtol=0.06)
    true = np.array([camera.intrinsics for camera in arm.cameras])
    assert np.all(np.abs(evidence.observations.intrinsics[:, :2] / true[:, :2] - 1) <= 0.01)
    assert seen.sum(axis=(1, 2)).min() >= 6


def test_actions_without_noise_lead_from_posture_to_posture(arm):
    rng = np.random.default_rng(1)
    evidence = act(arm, 12, NoisyController(0.0, "independent", rng), rng)
    assert evidence.truth.joints is not None
    np.testing.assert_allclose(np.diff(evidence.truth.joints, axis=0), evidence.observations.actions, atol=1e-12)
    evidence = act_cartesian(arm, 12, NoisyController(0.0, "independent", rng), rng)
    poses = evidence.truth.poses
    np.testing.assert_allclose(evidence.observations.actions @ poses[:-1], poses[1:], atol=1e-9)
    assert evidence.observations.joints is None


def test_laws_of_noise():
    step = np.full(6, 0.02)
    moved = {
        law: np.array([NoisyController(0.01, law, np.random.default_rng(seed)).joint_step(step) for seed in range(400)])
        for law in ("independent", "proportional")
    }
    np.testing.assert_allclose((moved["independent"] - step).std(), 0.01, rtol=0.05)
    expected = 0.01 * np.linalg.norm(step) / REFERENCE_MOVE
    np.testing.assert_allclose((moved["proportional"] - step).std(), expected, rtol=0.05)
    still = NoisyController(0.01, "proportional", np.random.default_rng(0)).transform(np.eye(4))
    np.testing.assert_allclose(still, np.eye(4), atol=1e-12)


def test_a_noisy_pose_is_a_pose():
    poses = [noisy_pose(np.eye(4), 0.01, np.random.default_rng(seed)) for seed in range(200)]
    for pose in poses:
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.std([pose[:3, 3] for pose in poses]), 0.01, rtol=0.1)


def test_unknown_laws_are_answered(arm):
    rng = np.random.default_rng(0)
    with pytest.raises(DenseVSError, match="'normal', 'uniform'"):
        draw_joints(arm, 3, rng, "gaussian")
    with pytest.raises(DenseVSError, match="'independent', 'proportional'"):
        NoisyController(0.01, "white", rng)
    with pytest.raises(DenseVSError, match="sigma is -1"):
        NoisyController(-1, "independent", rng)
