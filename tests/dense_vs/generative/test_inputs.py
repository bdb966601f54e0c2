"""Input that cannot determine a model is refused by name, or what it leaves open is reported."""

from contextlib import suppress

import numpy as np
import pytest
from arm_recordings import SIZE, record

from dense_vs import DenseVSError
from dense_vs.generative import GenerativeModel, Observations
from dense_vs.generative.reconstruction import initialization
from dense_vs.generative.reconstruction.bundle_adjustment import adjust_bundle


def assert_refused(match, call):
    with pytest.raises(DenseVSError, match=match):
        call()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pixels": None}, "pixels are missing"),
        ({"pixels": np.zeros((5, 2, 12))}, r"pixels have shape \(5, 2, 12\)"),
        ({"joints": np.zeros((4, 6))}, r"joints have shape \(4, 6\); expected \(50, any\)"),
        ({"joints": np.full((50, 6), np.nan)}, r"joints\[0, 0\] is nan"),
        ({"actions": np.zeros((50, 6))}, r"actions have shape \(50, 6\); expected \(49, 6\)"),
        ({"actions": np.zeros((49, 4, 4))}, r"actions\[0\]"),
        ({"poses": np.ones((50, 4, 4))}, r"poses\[0\]"),
        ({"intrinsics": np.ones((2, 5))}, "rows fx, fy, cx, cy"),
        ({"intrinsics": -np.ones((2, 4))}, "fx, fy > 0"),
        ({"intrinsics_sigma": (0.01, -8.0)}, "two numbers above 0"),
        ({"intrinsics_sigma": (0.01, 8.0), "intrinsics": None}, "without intrinsics"),
        ({"image_sizes": [SIZE]}, r"expected 2 pairs \(h, w\)"),
        ({"feature_link": np.full(12, 7)}, "from 0 to 6"),
        ({"feature_link": np.full(12, 2.0)}, "whole numbers"),
    ],
)
def test_observations(ur5, changes, message):
    arrays = {"joints": ur5.joints, "pixels": ur5.pixels, "intrinsics": ur5.intrinsics, "image_sizes": [SIZE] * 2}
    assert_refused(message, lambda: Observations(**(arrays | changes)))


def test_half_a_coordinate_and_infinity(ur5):
    for value in (np.nan, np.inf):
        pixels = ur5.pixels.copy()
        t, c, m = np.argwhere(np.isfinite(pixels[..., 0]))[0]
        pixels[t, c, m, 0] = value
        assert_refused("half a coordinate", lambda pixels=pixels: ur5.observations(pixels=pixels))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kinematics": "screw"}, "expected one of poe, dh"),
        ({"state": "seen"}, "expected one of observed, noisy, actions"),
        ({"controller": "arm"}, "expected one of joint, cartesian"),
        ({"method": "adam"}, "expected one of lm, paper"),
        ({"noise": "white"}, "expected one of constant, proportional"),
        ({"distortion": 3}, "distortion is 3"),
        ({"distortion": True}, "distortion is True"),
        ({"seed": -1}, "seed is -1"),
        ({"pixel_sigma": float("nan")}, "pixel_sigma is nan"),
        ({"controller": "cartesian", "state_sigma": (0.1, 0.0)}, r"state_sigma\[1\] is 0.0"),
        ({"controller": "cartesian", "state_sigma": 0.1}, "expected 2 numbers"),
        ({"state_sigma": -1.0}, "state_sigma"),
        ({"method": "paper"}, "published for kinematics 'dh'"),
        ({"state": "actions"}, "needs actions"),
        ({"controller": "cartesian"}, "needs poses"),
        ({"controller": "cartesian", "state": "actions"}, "needs actions"),
    ],
)
def test_options(ur5, options, message):
    assert_refused(message, lambda: GenerativeModel.fit(ur5.observations(), **options))


def test_too_few_views(ur5):
    assert_refused("6 joints need at least 5", lambda: GenerativeModel.fit(ur5.observations()[:4]))
    few = ur5.pixels.copy()
    few[:, :, 3:] = np.nan
    assert_refused("3 features of the last link", lambda: GenerativeModel.fit(ur5.observations(pixels=few)))


def test_a_camera_that_sees_nothing(ur5):
    pixels = ur5.pixels.copy()
    pixels[:, 1] = np.nan
    assert_refused("camera 1 saw no feature", lambda: GenerativeModel.fit(ur5.observations(pixels=pixels)))


def test_features_never_seen_together(ur5):
    pixels = ur5.pixels.copy()
    pixels[:, 0, 6:], pixels[:, 1, :6] = np.nan, np.nan
    assert_refused("camera 1 saw too few features", lambda: GenerativeModel.fit(ur5.observations(pixels=pixels)))


@pytest.mark.slow
def test_features_on_a_line(ur5):
    arm = record("ur5", 0).arm
    arm.features = np.linspace(-0.08, 0.08, 12)[:, None] * [0.6, 0.0, 0.8] + [0.0, 0.0, 0.06]
    arm.normals = np.tile(arm.normals.mean(axis=0), (12, 1))
    pixels = arm.see(ur5.joints, np.random.default_rng(0), 0.5, hide=False)
    assert_refused("line", lambda: GenerativeModel.fit(ur5.observations(pixels=pixels)))


def test_features_in_a_plane(ur5):
    arm = record("ur5", 0).arm
    rng = np.random.default_rng(1)
    arm.features = np.column_stack([rng.uniform(-0.08, 0.08, (12, 2)), np.full(12, 0.06)])
    pixels = arm.see(ur5.joints, rng, 0.5, hide=False)
    model = GenerativeModel.fit(ur5.observations(pixels=pixels))  # two cameras do
    unseen = arm.see(ur5.unseen_joints, rng, 0.5, hide=False)
    assert np.mean(np.linalg.norm(model.pixels(ur5.unseen_joints) - unseen, axis=-1)) < 0.75
    alone = {"pixels": pixels[:, :1], "intrinsics": ur5.intrinsics[:1], "image_sizes": [SIZE]}
    model = GenerativeModel.fit(ur5.observations(**alone))  # and one does, by perspective
    assert np.mean(np.linalg.norm(model.pixels(ur5.unseen_joints) - unseen[:, :1], axis=-1)) < 0.85


def test_a_joint_that_never_moved(ur5):
    arm, joints = ur5.arm, ur5.joints.copy()
    joints[:, 3] = arm.home[3]
    pixels = arm.see(joints, np.random.default_rng(0), 0.5)
    model = GenerativeModel.fit(ur5.observations(joints=joints, pixels=pixels))
    assert model.report.still_joints == [4]
    assert any("joint 4" in words for words in model.report.unobservable)
    assert np.nanmean(np.linalg.norm(model.pixels(joints) - pixels, axis=-1)) < 0.7
    assert_refused("joint 4 is .* its axis is unknown", lambda: model.pixels(ur5.unseen_joints))


def test_a_feature_that_was_hardly_seen_is_unknown(ur5):
    pixels = ur5.pixels.copy()
    pixels[:, :, 7] = np.nan
    model = GenerativeModel.fit(ur5.observations(pixels=pixels))
    assert any("feature 7" in words for words in model.report.unobservable)
    assert np.isnan(model.pixels(ur5.unseen_joints)[:, :, 7]).all()
    assert np.isfinite(model.pixels(ur5.unseen_joints)[:, :, :7]).all()


def test_use_of_a_model(ur5, model):
    assert_refused(r"joints have shape \(2, 5\)", lambda: model.pixels(np.zeros((2, 5))))
    assert_refused(r"pixels have shape \(1, 12, 2\)", lambda: model.infer_joints(ur5.pixels[0, :1]))
    assert_refused("image 0 shows 0 known features", lambda: model.infer_joints(np.full((2, 12, 2), np.nan)))
    assert_refused(r"near has shape \(5,\)", lambda: model.infer_joints(ur5.pixels[0], near=np.zeros(5)))
    assert_refused(r"actions have shape \(3, 6\)", lambda: model.infer_joints(ur5.pixels[:3], actions=np.zeros((3, 6))))
    for what in ("camera:5", "camera:x", "tool", "structure:99"):
        assert_refused("expected", lambda what=what: model.relearn(ur5.observations(), what))
    assert_refused("capacity", lambda: model.online(0))
    assert_refused("relearn_after", lambda: model.online(relearn_after=-1))
    assert_refused("expected finite", lambda: model.online().add(np.zeros(5), ur5.pixels[0]))


def test_work_on_lenses_that_are_far_off_is_bounded(ur5, monkeypatch):
    """No adjustment finds anything good, so that every method would be tried again and again.

    What they leave is refused or not by how a processor rounds; that it is refused is tested with the stages.
    """
    done = []

    def hopeless(pixels, guess, found, max_iterations):
        done.append(max_iterations)
        return adjust_bundle(pixels, guess, found, 1)

    monkeypatch.setattr(initialization, "adjust_bundle", hopeless)
    wrong = ur5.intrinsics * [0.1, 0.1, 1.0, 1.0]
    with suppress(DenseVSError):
        GenerativeModel.fit(ur5.observations(intrinsics=wrong)[:15])
    assert 1 < len(done) <= 14  # twelve, and a pair is adjusted to its end


def test_images_far_from_any_lens_are_no_noise(ur5):
    """Errors of 8 px are no detector's, unless its user says so."""
    pixels = ur5.pixels + np.random.default_rng(0).normal(0, 8.0, ur5.pixels.shape)
    noisy = ur5.observations(pixels=pixels)[:25]
    report = GenerativeModel.fit(noisy).report
    assert not report.converged
    assert report.misfit == pytest.approx(report.rms_px)
    told = GenerativeModel.fit(noisy, pixel_sigma=8.0).report
    assert told.converged
    assert told.misfit == pytest.approx(1.0, abs=0.15)
