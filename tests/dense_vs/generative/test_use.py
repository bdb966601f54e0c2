"""A learned model in use: inference, commands, relearning, watching for changes, files."""

import copy

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs import DenseVSError
from dense_vs.generative import GenerativeModel


def error_px(model, joints, pixels):
    return float(np.nanmean(np.linalg.norm(model.pixels(joints) - pixels, axis=-1)))


def test_joints_of_images(ur5, model):
    near = ur5.unseen_joints + np.random.default_rng(0).normal(0, 0.1, ur5.unseen_joints.shape)
    joints = model.infer_joints(ur5.unseen_pixels, near=near)
    assert np.median(np.abs(joints - ur5.unseen_joints)) < 0.01
    assert error_px(model, joints, ur5.unseen_pixels) < 0.65
    alone = model.infer_joints(ur5.unseen_pixels)
    assert error_px(model, alone, ur5.unseen_pixels) < 0.65
    np.testing.assert_array_equal(model.infer_joints(ur5.unseen_pixels[3]), alone[3])


def test_joints_of_a_sequence(ur5, model):
    steps = np.diff(ur5.unseen_joints[:6], axis=0)
    joints = model.infer_joints(ur5.unseen_pixels[:6], actions=steps)
    np.testing.assert_allclose(np.diff(joints, axis=0), steps, atol=5e-3)
    assert np.abs(joints - ur5.unseen_joints[:6]).max() < 0.02


def test_a_mistaken_feature_hardly_pulls_a_robust_inference(ur5, model):
    image, near = ur5.unseen_pixels[2].copy(), ur5.unseen_joints[2]
    wrong = np.flatnonzero(np.isfinite(image[0, :, 0]))[0]
    image[0, wrong] += 25.0
    off = [np.abs(model.infer_joints(image, near=near, robust=robust) - near).max() for robust in (False, True)]
    assert off[1] < 0.5 * off[0]


def test_a_command_reaches_the_target(ur5, model):
    reached = []
    for k in range(10):
        joints, target = ur5.unseen_joints[k], ur5.unseen_pixels[k + 10]
        step = model.command(ur5.unseen_pixels[k], target, near=joints)
        after = ur5.arm.see(joints + step, hide=False)[0]
        reached.append(np.nanmean(np.linalg.norm(after - ur5.arm.see(ur5.unseen_joints[k + 10])[0], axis=-1)))
    assert np.median(reached) < 1.0


def test_poses_of_the_hand(ur5, model):
    poses = model.infer_poses(ur5.unseen_pixels)
    p = model.parameters
    world = np.einsum("tij,mj->tmi", poses[:, :3, :3], p.features) + poses[:, None, :3, 3]
    seen = np.einsum("cij,tmj->tcmi", p.camera_rotation, world) + p.camera_translation[:, None]
    pixels = seen[..., :2] / seen[..., 2:] * p.intrinsics[:, None, :2] + p.intrinsics[:, None, 2:4]
    assert np.nanmean(np.linalg.norm(pixels - ur5.unseen_pixels, axis=-1)) < 0.65


def changed_arm(ur5, what):
    arm = copy.deepcopy(ur5.arm)
    turn = Rotation.from_rotvec([0.05, -0.08, 0.06]).as_matrix()
    if what == "camera:1":
        camera = arm.cameras[1]
        camera.rotation, camera.translation = turn @ camera.rotation, camera.translation + np.array([0.03, -0.02, 0.04])
    elif what == "structure":
        arm.features = arm.features + np.random.default_rng(3).normal(0, 0.02, arm.features.shape)
    elif what == "base":
        for camera in arm.cameras:
            camera.translation = camera.translation + camera.rotation @ [0.03, 0.02, -0.03]
            camera.rotation = camera.rotation @ turn
    return arm


@pytest.mark.parametrize(
    ("what", "samples", "limit"),
    [("camera:1", 5, 1.2), ("structure", 4, 1.2), ("base", 3, 1.2), ("kinematics", 25, 0.8)],
)
def test_relearning(ur5, copied, what, samples, limit):
    arm = changed_arm(ur5, what)
    joints, pixels = arm.record(np.random.default_rng(4), samples)
    unseen, truth = arm.record(np.random.default_rng(5), 30)
    before = copied.parameters
    report = copied.relearn(ur5.observations(joints=joints, pixels=pixels), what)
    assert report.stages[0].name == what
    assert error_px(copied, unseen, truth) < limit
    kept = {
        "camera:1": ("axes", "points", "features"),
        "structure": ("axes", "points", "camera_rotation", "intrinsics"),
        "base": ("axes", "points", "features", "camera_rotation"),
        "kinematics": ("camera_rotation", "camera_translation", "intrinsics"),
    }[what]
    for name in kept:
        np.testing.assert_array_equal(getattr(copied.parameters, name), getattr(before, name))


def test_a_new_camera_and_new_features(ur5, copied):
    arm = copy.deepcopy(ur5.arm)
    third = copy.deepcopy(arm.cameras[0])
    third.translation = third.translation + np.array([0.1, 0.05, 0.1])
    arm.cameras.append(third)
    arm.features = np.vstack([arm.features, arm.features[:2] + 0.01])
    arm.normals = np.vstack([arm.normals, arm.normals[:2]])
    arm.links = np.append(arm.links, [6, 6])
    joints, pixels = arm.record(np.random.default_rng(6), 8)
    guesses = np.vstack([ur5.intrinsics, ur5.intrinsics[0]])
    obs = ur5.observations(joints=joints, pixels=pixels[:, :, :12], intrinsics=guesses)
    copied.relearn(obs, "camera:2")
    copied.relearn(ur5.observations(joints=joints, pixels=pixels, intrinsics=guesses), "structure:12,13")
    unseen, truth = arm.record(np.random.default_rng(7), 30)
    assert error_px(copied, unseen, truth) < 1.2


def test_a_shifted_camera_is_named_and_relearned(ur5, copied):
    watch = copied.online(capacity=40, relearn_after=4)
    quiet = [watch.add(q, x) for q, x in zip(ur5.unseen_joints[:15], ur5.unseen_pixels[:15], strict=True)]
    assert not any(change.moved_cameras or change.everything_moved for change in quiet)
    arm = changed_arm(ur5, "camera:1")
    joints, pixels = arm.record(np.random.default_rng(8), 4)
    first = watch.add(joints[0], pixels[0])
    assert first.moved_cameras == (1,)
    assert watch.ignored == {1}
    assert first.gradient_norm > 3 * quiet[-1].gradient_norm
    assert first.camera_gradient_ratios[1] > 20 > first.camera_gradient_ratios[0]
    hardly = pixels[0].copy()
    hardly[1, 3:] = np.nan
    watch.add(joints[0], hardly)  # too little of the moved camera to count for it
    for number, (q, x) in enumerate(zip(joints[1:], pixels[1:], strict=True)):
        assert watch.ignored == {1}, number
        watch.add(q, x)
    assert not watch.ignored
    unseen, truth = arm.record(np.random.default_rng(9), 30)
    assert error_px(copied, unseen, truth) < 1.5


def test_a_moved_base_is_no_moved_camera(ur5, copied):
    watch = copied.online()
    joints, pixels = changed_arm(ur5, "base").record(np.random.default_rng(8), 1)
    change = watch.add(joints[0], pixels[0])
    assert change.everything_moved
    assert change.moved_cameras == ()


def test_save_and_load(ur5, model, tmp_path):
    path = tmp_path / "model.npz"
    model.save(path)
    again = GenerativeModel.load(path)
    np.testing.assert_array_equal(again.pixels(ur5.unseen_joints), model.pixels(ur5.unseen_joints))
    np.testing.assert_array_equal(again.infer_joints(ur5.unseen_pixels), model.infer_joints(ur5.unseen_pixels))
    assert again.report == model.report
    content = dict(np.load(path))
    assert content["controller"] == "joint"
    wide = np.zeros((3, again.parameters.joint_count + 1))  # as a controller in space has them, that of joints not
    np.savez(tmp_path / "in_space.npz", **(content | {"controller": "cartesian", "postures": wide}))
    GenerativeModel.load(tmp_path / "in_space.npz")
    damages = (
        {"format": "x"}, {"format_version": 9}, {"parameters_axes": np.zeros((5, 3))}, {"report": "{"},
        {"postures": wide},
    )  # fmt: skip
    for change in damages:
        np.savez(tmp_path / "bad.npz", **(content | change))
        with pytest.raises(DenseVSError, match=r"bad\.npz"):
            GenerativeModel.load(tmp_path / "bad.npz")
