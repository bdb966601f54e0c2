"""Setups of the marked arm as they are described: where cameras and features are, how postures and lenses vary."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.marked_arm import evidence
from dense_vs.sims.marked_arm.dh_chain import BAXTER, UR5, find_arm
from dense_vs.sims.marked_arm.evidence import (
    act,
    act_cartesian,
    draw_joints,
    executed,
    guessed_intrinsics,
    observe,
    random_pose_near,
)
from dense_vs.sims.marked_arm.noise import NoisyController
from dense_vs.sims.marked_arm.observed_arm import PinholeCamera, make_observed_arm

ARMS = [make_observed_arm(name, seed=seed, cameras=cameras) for name in ("ur5", "baxter") for seed in range(12)
        for cameras in (1, 2, 3)]  # fmt: skip


def center_of(arm):
    home = arm.chain.flange_pose(arm.chain.home)
    return home, home[:3, 3] + 0.06 * home[:3, 2]


def test_published_parameters():
    """Lengths in m as Universal Robots and Ju, Yang and Ma print them."""
    assert UR5.d.tolist() == [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]
    assert UR5.a.tolist() == [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(np.rad2deg(UR5.alpha), [90, 0, 0, 90, -90, 0])
    assert BAXTER.d.tolist() == [0.27035, 0.0, 0.36435, 0.0, 0.37429, 0.0, 0.229525]
    assert BAXTER.a.tolist() == [0.069, 0.0, 0.069, 0.0, 0.010, 0.0, 0.0]
    np.testing.assert_allclose(np.rad2deg(BAXTER.alpha), [-90, 90, -90, 90, -90, 90, 0])
    np.testing.assert_allclose(np.rad2deg(BAXTER.omega), [0, 90, 0, 0, 0, 0, 0])
    for arm in (UR5, BAXTER):
        pose = arm.flange_pose(arm.home)
        assert pose[2, 2] < -0.99  # the tool points down
        assert 0.4 < np.hypot(*pose[:2, 3]) < 1.0  # before the arm
        assert 0.1 < pose[2, 3] < 0.7
        assert find_arm(arm.name) is arm


def test_cameras_stand_about_two_steps_away_on_an_arc_and_look_at_the_hand():
    distances, elevations, off, rolls, azimuths = [], [], [], [], []
    for arm in ARMS:
        _, center = center_of(arm)
        ways = [camera.center - center for camera in arm.cameras]
        distances += [np.linalg.norm(way) for way in ways]
        elevations += [np.arcsin(way[2] / np.linalg.norm(way)) for way in ways]
        azimuths.append([np.arctan2(way[1], way[0]) for way in ways])
        off += [np.abs(camera.project(center[None])[0] - [319.5, 239.5]) for camera in arm.cameras]
        rolls += [np.arcsin(camera.T_camera_world[0, 2]) for camera in arm.cameras]
    assert 1.53 <= min(distances) < 1.56
    assert 1.84 < max(distances) <= 1.87
    assert 0.25 <= min(elevations) < 0.27
    assert 0.58 < max(elevations) <= 0.6
    for ones in azimuths:
        expected = np.linspace(-0.7, 0.7, len(ones)) if len(ones) > 1 else [0.0]
        assert np.abs(np.array(ones) - expected).max() <= 0.1
    assert np.median(off) < 20  # looked at to about 5 cm
    assert np.max(off) < 100
    assert np.std(rolls) == pytest.approx(0.1, rel=0.4)


def test_lenses_are_about_alike():
    values = np.array([camera.intrinsics for arm in ARMS for camera in arm.cameras])
    assert (np.abs(values[:, :2] / 620.0 - 1) < 0.0525).all()
    assert np.ptp(values[:, 0]) > 40
    assert 0 < np.abs(values[:, 0] / values[:, 1] - 1).max() < 0.0041
    assert np.abs(values[:, 2:] - [319.5, 239.5]).max() <= 6.0
    assert np.abs(values[:, 2:] - [319.5, 239.5]).max() > 5.5


def test_features_are_on_a_bumpy_tool_that_faces_the_cameras():
    for arm in ARMS:
        assert arm.features.shape == (12, 3)
        np.testing.assert_allclose(np.linalg.norm(arm.normals, axis=1), 1.0)
        radius = np.linalg.norm(arm.features - [0.0, 0.0, 0.06], axis=1)
        assert radius.min() >= 0.6 * 0.07
        assert radius.max() <= 1.2 * 0.07
        np.testing.assert_allclose(arm.features - [0, 0, 0.06], radius[:, None] * arm.normals)
        home, center = center_of(arm)
        middle = sum((camera.center - center) / np.linalg.norm(camera.center - center) for camera in arm.cameras)
        towards = home[:3, :3].T @ (middle / np.linalg.norm(middle))
        assert np.rad2deg(np.arccos(arm.normals @ towards)).max() < 60.0
    assert max(np.rad2deg(np.arccos(np.clip(arm.normals @ arm.normals.T, -1, 1))).max() for arm in ARMS) > 80


def test_other_features_are_before_the_same_cameras():
    one, other = make_observed_arm("ur5", seed=3), make_observed_arm("ur5", seed=3, feature_seed=4)
    assert (one.cameras[0].T_camera_world == other.cameras[0].T_camera_world).all()
    assert not np.allclose(one.features, other.features)
    assert len(one.cameras) == 2
    for wrong in ({"cameras": 0}, {"features": 3}, {"arm": "nobody"}):
        with pytest.raises(DenseVSError):
            make_observed_arm(**{"arm": "ur5", "seed": 0, **wrong})
    assert len(make_observed_arm("ur5", seed=0, features=4).features) == 4


def test_a_knocked_camera_has_moved_as_far_as_told():
    camera = ARMS[0].cameras[0]
    knocked = camera.shifted(np.random.default_rng(0), 0.1, 0.15)
    motion = knocked.T_camera_world @ np.linalg.inv(camera.T_camera_world)
    assert np.linalg.norm(motion[:3, 3]) == pytest.approx(0.1)
    assert np.arccos((np.trace(motion[:3, :3]) - 1) / 2) == pytest.approx(0.15)


def test_what_is_behind_a_camera_or_beside_its_image_is_not_seen():
    camera = PinholeCamera(np.array([600.0, 600.0, 319.5, 239.5]), np.eye(4))
    np.testing.assert_allclose(camera.project(np.array([[0.1, -0.2, 2.0]])), [[349.5, 179.5]])
    assert np.isnan(camera.project(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]))).all()
    arm = ARMS[0]
    seen = arm.pixels(arm.chain.home[None])[0]
    shown = seen[np.isfinite(seen[..., 0])]
    assert len(shown) >= 6
    assert (shown >= 0).all()
    assert (shown <= [639, 479]).all()


@pytest.mark.parametrize(("degrees", "seen"), [(77.0, True), (79.0, False), (-77.0, True), (-79.0, False)])
def test_a_feature_is_hidden_that_faces_more_than_78_degrees_away(degrees, seen):
    from dataclasses import replace

    one = make_observed_arm("ur5", seed=0, cameras=1)
    camera, pose = one.cameras[0], one.chain.flange_pose(one.chain.home)
    point = pose[:3, 3] + 0.06 * pose[:3, 2]
    ray = (camera.center - point) / np.linalg.norm(camera.center - point)
    across = np.cross(ray, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    angle = np.deg2rad(degrees)
    normal = np.cos(angle) * ray + np.sin(angle) * across
    arm = replace(one, features=np.array([[0.0, 0.0, 0.06]]), normals=(pose[:3, :3].T @ normal)[None])
    assert np.isfinite(arm.pixels(one.chain.home[None])).all() == seen


@pytest.mark.parametrize(("law", "spread", "most"), [("normal", 0.3, 2.0), ("uniform", 1 / np.sqrt(3), 1.0)])
def test_postures_follow_their_law(law, spread, most):
    arm = ARMS[1]
    rng = np.random.default_rng(0)
    joints = np.array([evidence._posture(arm, rng, law) for _ in range(1500)]) - arm.chain.home
    np.testing.assert_allclose(joints.std(axis=0), spread, rtol=0.06)
    np.testing.assert_allclose(joints.mean(axis=0), 0.0, atol=0.06)
    assert np.abs(joints).max() <= most
    drawn = draw_joints(arm, 30, rng, law)
    assert drawn.shape == (30, arm.chain.joint_count)
    assert np.isfinite(arm.pixels(drawn)[..., 0]).sum(axis=(1, 2)).min() >= 6
    one = draw_joints(arm, 30, rng, law, camera=1)
    assert np.isfinite(arm.pixels(one)[:, 1, :, 0]).sum(axis=1).min() >= 4


def test_postures_are_given_up_where_too_little_is_seen(monkeypatch):
    monkeypatch.setattr(evidence, "_count", lambda pixels: 5)
    with pytest.raises(DenseVSError, match="only 0 of 3 postures show 6 features; move the cameras"):
        draw_joints(ARMS[1], 3, np.random.default_rng(0))
    monkeypatch.setattr(evidence, "_count", lambda pixels: 6)
    assert len(draw_joints(ARMS[1], 3, np.random.default_rng(0))) == 3
    monkeypatch.setattr(evidence, "_count", lambda pixels: 6 if pixels.ndim == 4 and pixels.shape[1] == 2 else 3)
    with pytest.raises(DenseVSError, match="only 0 of 3"):
        draw_joints(ARMS[1], 3, np.random.default_rng(0), camera=0)


def test_lenses_are_told_within_their_tolerances():
    arm, rng = ARMS[1], np.random.default_rng(0)
    true = np.array([camera.intrinsics for camera in arm.cameras])
    guesses = np.array([guessed_intrinsics(arm, rng) for _ in range(600)])
    share, off = guesses[..., :2] / true[:, :2] - 1, guesses[..., 2:] - true[:, 2:]
    assert 0.0099 < np.abs(share).max() <= 0.01
    assert 7.9 < np.abs(off).max() <= 8.0
    assert abs(share.mean()) < 5e-4
    assert abs(off.mean()) < 0.4
    assert pytest.approx((share.std(), off.std()), rel=0.05) == evidence.INTRINSICS_SIGMA
    assert observe(arm, arm.chain.home[None], rng).observations.intrinsics_sigma is not None
    assert observe(arm, arm.chain.home[None], rng, tolerances_known=False).observations.intrinsics_sigma is None


def test_cartesian_steps_are_centimeters_and_fractions_of_a_radian():
    rng, pose = np.random.default_rng(0), ARMS[1].chain.flange_pose(ARMS[1].chain.home)
    moved = np.array([random_pose_near(pose, rng) for _ in range(1500)])
    np.testing.assert_allclose((moved[:, :3, 3] - pose[:3, 3]).std(axis=0), 0.06, rtol=0.06)
    turn = moved[:, :3, :3] @ pose[:3, :3].T
    angle = np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert np.sqrt(np.mean(angle**2) / 3) == pytest.approx(0.25, rel=0.06)


def test_noise_of_a_cartesian_step_acts_at_the_hand():
    pose = ARMS[1].chain.flange_pose(ARMS[1].chain.home)
    action = random_pose_near(pose, np.random.default_rng(1)) @ np.linalg.inv(pose)
    exact = NoisyController(0.0, "independent", np.random.default_rng(0))
    np.testing.assert_allclose(executed(exact, action, pose), action @ pose, atol=1e-12)
    noisy = NoisyController(0.01, "independent", np.random.default_rng(0))
    done = np.array([executed(noisy, action, pose) for _ in range(2000)])
    np.testing.assert_allclose(done[:, :3, 3].std(axis=0), 0.01, rtol=0.08)  # and not the lever about the base times it
    np.testing.assert_allclose(done[:, :3, 3].mean(axis=0), (action @ pose)[:3, 3], atol=1e-3)


def test_cartesian_actions_lead_from_pose_to_pose():
    arm, exact = ARMS[1], NoisyController(0.0, "independent", np.random.default_rng(0))
    seen = act_cartesian(arm, 12, exact, np.random.default_rng(0))
    assert len(seen.truth.poses) == 12
    for action, before, after in zip(seen.observations.actions, seen.truth.poses, seen.truth.poses[1:], strict=False):
        np.testing.assert_allclose(action @ before, after, atol=1e-9)
    assert seen.truth.joints is None
    noise = seen.observations.pixels - seen.truth.pixels
    assert np.nanstd(noise) == pytest.approx(0.5, rel=0.15)
    assert abs(np.nanmean(noise)) < 0.1
    some = act(arm, 12, exact, np.random.default_rng(0)).first(5)
    assert len(some.truth.joints) == len(some.truth.poses) == len(some.truth.pixels) == 5
    assert len(some.observations.pixels) == 5
