from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm import evidence as module
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
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_allclose((evidence.observations.joints - joints).mean(), 0.0, atol=0.004)
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


def test_a_pose_that_is_read_without_noise_is_the_pose():
    pose = np.array([[0.0, -1.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.25], [0.0, 0.0, 1.0, 0.125], [0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(noisy_pose(pose, 0.0, np.random.default_rng(0)), pose, atol=1e-12)
    read = np.mean([noisy_pose(pose, 0.01, np.random.default_rng(seed)) for seed in range(200)], axis=0)
    np.testing.assert_allclose(read, pose, atol=4e-3)


@pytest.mark.parametrize(("law", "share"), [("independent", 1.0), ("proportional", 0.25)])
def test_noise_of_a_turn_and_of_a_shift_goes_by_their_own_lengths(law, share):
    """A shift by a quarter of a meter and a turn by a quarter of a radian; nothing is drawn but ones."""
    ones = SimpleNamespace(normal=lambda size: np.full(size, 1.0))
    action = np.eye(4)
    action[0, 3] = 0.25
    done = NoisyController(0.02, law, ones).transform(action)
    np.testing.assert_allclose(done[:3, 3], np.array([0.25, 0.0, 0.0]) + 0.02 * share)
    turned = Rotation.from_matrix(done[:3, :3]).as_euler("xyz")
    np.testing.assert_allclose(turned, np.full(3, 0.02 * (law == "independent")), atol=1e-12)  # it does not turn
    action = np.eye(4)
    action[:3, :3] = Rotation.from_euler("xyz", [0.0, 0.0, 0.25]).as_matrix()
    done = NoisyController(0.02, law, ones).transform(action)
    np.testing.assert_allclose(done[:3, 3], np.full(3, 0.02 * (law == "independent")), atol=1e-12)
    turned = Rotation.from_matrix(done[:3, :3]).as_euler("xyz")
    np.testing.assert_allclose(turned, np.array([0.0, 0.0, 0.25]) + 0.02 * share)
    step = NoisyController(0.02, law, ones).joint_step(np.array([0.15, -0.2]))
    np.testing.assert_allclose(step, np.array([0.15, -0.2]) + 0.02 * share)


def test_unknown_laws_are_answered(arm):
    rng = np.random.default_rng(0)
    with pytest.raises(DenseVSError, match="expected one of normal, uniform"):
        draw_joints(arm, 3, rng, "gaussian")
    with pytest.raises(DenseVSError, match="expected one of independent, proportional"):
        NoisyController(0.01, "white", rng)
    with pytest.raises(DenseVSError, match="sigma is -1"):
        NoisyController(-1, "independent", rng)


class Line:
    """An arm of one joint before one camera that sees the features of these postures; the others are hidden."""

    image_sizes = ((10, 10),)
    cameras = (SimpleNamespace(intrinsics=np.array([10.0, 10.0, 5.0, 5.0])),)

    def __init__(self, *seen):
        self.chain = SimpleNamespace(home=np.zeros(1), joint_count=1, flange_pose=self.pose)
        self.seen = (0.0, *seen)

    @staticmethod
    def pose(joints):
        poses = np.tile(np.eye(4), (*np.shape(joints)[:-1], 1, 1))
        poses[..., 0, 3] = np.asarray(joints)[..., 0]
        return poses

    def pixels_of_poses(self, poses):
        there = np.isclose(poses[:, 0, 3, None], self.seen).any(axis=1)
        return np.where(there[:, None, None, None], poses[:, 0, 3][:, None, None, None], np.nan) * np.ones((1, 6, 2))

    def pixels(self, joints):
        return self.pixels_of_poses(self.pose(joints))


@pytest.fixture
def postures(monkeypatch):
    """Joint positions that are drawn, one after the other."""

    def draw(*places):
        remaining = [np.array([place]) for place in places]
        monkeypatch.setattr(module, "_posture", lambda *_: remaining.pop(0))
        monkeypatch.setattr(module, "random_pose_near", lambda *_: Line.pose(remaining.pop(0)))

    return draw


def test_steps_lead_from_one_drawn_posture_to_the_next_and_add_up_where_too_little_is_seen(postures):
    exact = NoisyController(0.0, "independent", np.random.default_rng(0))
    postures(0.5, -0.25, 0.75, 1.0)  # the second is not seen
    found = act(Line(0.5, 0.75, 1.0), 4, exact, np.random.default_rng(0))
    np.testing.assert_allclose(found.truth.joints[:, 0], [0.0, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(found.observations.actions[:, 0], [0.5, 0.25, 0.25])
    postures(0.5, -0.25, 0.75, 1.0)
    found = act_cartesian(Line(0.5, 0.75, 1.0), 4, exact, np.random.default_rng(0))
    np.testing.assert_allclose(found.truth.poses[:, 0, 3], [0.0, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(found.observations.actions[:, 0, 3], [0.5, 0.25, 0.25])


def test_a_controller_that_errs_leaves_its_errors_behind(postures):
    """It is told the way between the postures, and errs by 0.125 rad each time, which is never made good."""
    errs = SimpleNamespace(joint_step=lambda action: action + 0.125)
    postures(0.5, 0.75, 0.25)
    found = act(Line(0.625, 1.0), 3, errs, np.random.default_rng(0))
    np.testing.assert_allclose(found.truth.joints[:, 0], [0.0, 0.625, 1.0])
    np.testing.assert_allclose(found.observations.actions[:, 0], [0.5, 0.25])


def test_a_robot_that_is_not_seen_anywhere_has_made_no_steps(monkeypatch):
    draws = []
    monkeypatch.setattr(module, "_posture", lambda *_: draws.append(1) or np.ones(1))
    exact = NoisyController(0.0, "independent", np.random.default_rng(0))
    monkeypatch.setattr(module, "observe", lambda arm, joints, rng: pytest.fail(f"{len(joints)} after {len(draws)}"))
    with pytest.raises(pytest.fail.Exception, match="1 after 2000"):
        act(Line(), 2, exact, np.random.default_rng(0))


@pytest.mark.parametrize(("count", "enough"), [(5, False), (6, True)])
def test_six_features_are_enough(count, enough):
    pixels = np.full((1, 2, 6, 2), np.nan)
    pixels[0, :, :3] = 7.0
    pixels[0, 1, 2] = (np.nan, 7.0) if count == 5 else 7.0
    assert module._enough_seen(pixels) == enough
