"""One part of a model from a few samples, and what observations leave open, from exact pixels of an arm."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exact_arm import SIZES, exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative import Observations
from dense_vs.generative.kinematics.placement import place_cameras, place_features
from dense_vs.generative.learning import fitting, relearning
from dense_vs.generative.learning.relearning import relearn
from dense_vs.generative.least_squares.observability import _groups, describe_unobservable
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState


@pytest.fixture(scope="module")
def arm():
    return exact_arm()


def turned(vector):
    return Rotation.from_rotvec(vector).as_matrix()


def given(p, joints, cameras=2, **changes):
    return Observations(joints=joints, pixels=project(p, joints)[:, :cameras], image_sizes=SIZES[:1] * cameras,
                        **changes)  # fmt: skip


def learned(before, observations, what):
    return relearn(before, observations, what, 0.2, exact_arm().joints)


@pytest.mark.parametrize("gross", [0, 3])
def test_a_moved_camera_is_found_and_keeps_its_lens(arm, gross):
    p, joints = arm.parameters, arm.joints[:4]
    now = replace(p, camera_rotation=p.camera_rotation.copy(), camera_translation=p.camera_translation.copy())
    now.camera_rotation[1], now.camera_translation[1] = turned([0.0, -0.3, 0.1]), [0.5, 0.0, 2.4]
    observations = given(now, joints)
    observations.pixels[0, 1, :gross] += 40.0
    found, report = learned(p, observations, "camera:1")
    np.testing.assert_allclose(found.camera_rotation, now.camera_rotation, atol=2e-3)
    np.testing.assert_allclose(found.camera_translation, now.camera_translation, atol=1e-2)
    np.testing.assert_allclose(found.intrinsics, p.intrinsics, rtol=5e-3, atol=1e-2)
    np.testing.assert_array_equal(found.camera_rotation[0], p.camera_rotation[0])
    assert (found.axes is p.axes, found.features is p.features) == (True, True)
    assert report.rms_px < 0.05
    assert report.mean_error_px < 0.05
    assert report.stages[0].name == "camera:1"
    assert report.pixel_sigma == 0.2
    assert np.isfinite(report.expected_error_px)
    assert gross == 0 or report.stages[0].rms == report.rms_px


@pytest.mark.parametrize("told", [False, True])
def test_a_new_camera_is_added(arm, told):
    p, joints = arm.parameters, arm.joints
    third = np.array([[620.0, 620, 330, 235, 0, 0]])
    more = replace(p, camera_rotation=np.concatenate([p.camera_rotation, turned([0.2, 0.6, 0.0])[None]]),
                   camera_translation=np.vstack([p.camera_translation, [-0.8, 0.2, 2.1]]),
                   intrinsics=np.vstack([p.intrinsics, third]))  # fmt: skip
    changes = {"intrinsics": more.intrinsics[:, :4] + 5.0} if told else {}
    found, _ = learned(p, given(more, joints, 3, **changes), "camera:2")
    assert len(found.intrinsics) == 3
    np.testing.assert_allclose(found.camera_rotation[2], more.camera_rotation[2], atol=5e-3)
    np.testing.assert_allclose(found.camera_translation[2], more.camera_translation[2], atol=0.03)
    np.testing.assert_allclose(found.intrinsics[2, :4], third[0, :4], rtol=0.02)
    np.testing.assert_array_equal(found.intrinsics[:2], p.intrinsics)


def test_a_new_structure_is_found_whole_or_in_part(arm):
    p, joints = arm.parameters, arm.joints[:6]
    now = replace(p, features=p.features + np.random.default_rng(2).normal(0, 0.1, p.features.shape))
    some = replace(p, features=np.where(np.isin(np.arange(10), [1, 8])[:, None], now.features, p.features))
    found, report = learned(p, given(some, joints), "structure:1,8")
    np.testing.assert_allclose(found.features, some.features, atol=1e-4)
    np.testing.assert_array_equal(found.features[0], p.features[0])
    np.testing.assert_array_equal(found.links, p.links)
    assert report.rms_px < 0.01
    whole, _ = learned(p, given(now, joints, feature_link=p.links), "structure")
    np.testing.assert_allclose(whole.features, now.features, atol=1e-4)
    hand = replace(now, links=np.full(10, 3))
    all_on_hand, _ = learned(p, given(hand, joints), "structure")  # unless told, features are the hand's
    np.testing.assert_allclose(all_on_hand.features, now.features, atol=1e-4)
    assert (all_on_hand.links == 3).all()
    pixels = project(now, joints)
    pixels[:, :, 4] = np.nan
    pixels[0, 0, 4] = 100.0
    once = Observations(joints=joints, pixels=pixels, image_sizes=SIZES, feature_link=p.links)
    partly, _ = learned(p, once, "structure")
    assert np.isnan(partly.features[4]).all()
    np.testing.assert_allclose(np.delete(partly.features, 4, axis=0), np.delete(now.features, 4, axis=0), atol=1e-4)


@pytest.mark.parametrize("samples", [1, 4])
def test_a_moved_base_is_found(arm, samples):
    p = arm.parameters
    now = replace(p, base_rotation=turned([0.2, -0.1, 0.3]), base_translation=np.array([0.1, -0.2, 0.3]))
    found, report = learned(p, given(now, arm.joints[:samples]), "base")
    np.testing.assert_allclose(found.base_rotation, now.base_rotation, atol=1e-4)
    np.testing.assert_allclose(found.base_translation, now.base_translation, atol=1e-4)
    assert report.rms_px < 0.01
    again, _ = learned(found, given(now, arm.joints[samples : samples + 2]), "base")  # from a base that moved already
    np.testing.assert_allclose(again.base_translation, now.base_translation, atol=1e-4)


def test_a_base_is_sought_from_where_the_hand_is_seen(arm, monkeypatch):
    """Poses of the hand that are exact give it at once, wherever it was believed to be."""
    p = arm.parameters
    now = replace(p, base_rotation=turned([0.2, -0.1, 0.3]), base_translation=np.array([0.1, -0.2, 0.3]))
    believed = replace(p, base_rotation=turned([0.0, 0.4, 0.0]), base_translation=np.array([0.5, 0.0, 0.0]))
    starts = []
    robust = relearning._robust
    monkeypatch.setattr(relearning, "_robust", lambda problem, state: starts.append(state) or robust(problem, state))
    learned(believed, given(now, arm.joints[:4]), "base")
    np.testing.assert_allclose(starts[0].parameters.base_rotation, now.base_rotation, atol=1e-3)
    np.testing.assert_allclose(starts[0].parameters.base_translation, now.base_translation, atol=2e-3)


def test_new_kinematics_are_found(arm):
    p = arm.parameters
    axes = p.axes + np.array([[0.1, 0, 0], [0, 0, 0.3], [0.2, 0, 0]])
    now = replace(p, axes=axes / np.linalg.norm(axes, axis=1, keepdims=True), points=p.points + 0.03)
    found, report = learned(p, given(now, arm.joints), "kinematics")
    assert report.rms_px < 0.02
    other = arm.joints.mean(axis=0) + np.random.default_rng(3).uniform(-0.3, 0.3, (5, 3))
    np.testing.assert_allclose(project(found, other), project(now, other), atol=0.2)
    with pytest.raises(DenseVSError, match=r"known in 2 samples; 3 joints need 3"):
        learned(p, given(now, arm.joints[:2]), "kinematics")


@pytest.mark.parametrize(("what", "message"), [
    ("camera:3", "camera:0 to camera:1"), ("camera:x", "camera:0 to camera:1"), ("camera:2", "camera:0 to camera:1"),
    ("camera:²", "camera:0 to camera:1"), ("camera:" + "9" * 5000, "camera:0 to camera:1"),
    ("structure:²", "below 10"), ("structure:" + "9" * 5000, "below 10"),
    ("structure:10", "below 10"), ("structure:1,x", "below 10"), ("base:1", "what is 'base:1'"),
    ("kinematics:1", "what is 'kinematics:1'"), ("hand", "what is 'hand'"),
])  # fmt: skip
def test_what_is_no_part_of_a_model(arm, what, message):
    with pytest.raises(DenseVSError, match=message):
        learned(arm.parameters, arm.observations, what)


def test_samples_that_cannot_tell_a_part(arm):
    p = arm.parameters
    with pytest.raises(DenseVSError, match=r"joints have shape \(14, 2\)"):
        learned(p, Observations(joints=arm.joints[:, :2], pixels=arm.pixels, image_sizes=SIZES), "base")
    few = arm.pixels[:1].copy()
    few[:, 1, 3:] = np.nan
    with pytest.raises(DenseVSError, match="camera 1 saw 3 features"):
        learned(p, Observations(joints=arm.joints[:1], pixels=few, image_sizes=SIZES), "camera:1")
    with pytest.raises(DenseVSError, match="at least the model's 10"):
        learned(p, Observations(joints=arm.joints, pixels=arm.pixels[:, :, :9], image_sizes=SIZES), "structure:1")
    alone = np.full_like(arm.pixels, np.nan)
    alone[0, 0] = arm.pixels[0, 0]
    with pytest.raises(DenseVSError, match="no feature was seen from two directions"):
        learned(p, Observations(joints=arm.joints, pixels=alone, image_sizes=SIZES), "structure")
    hidden = arm.pixels.copy()
    hidden[:, :, 3:8] = np.nan
    with pytest.raises(DenseVSError, match="no sample shows 4 features"):
        learned(p, Observations(joints=arm.joints, pixels=hidden, image_sizes=SIZES), "base")


def test_features_and_cameras_are_placed_through_the_chain(arm):
    p = arm.parameters
    lost = p.copy()
    lost.features[[2, 9]] = np.nan
    pixels = arm.pixels.copy()
    pixels[0, 0, 2] += 30.0  # a mistaken label loses its weight
    found = place_features(lost, pixels, arm.joints)
    np.testing.assert_allclose(found.features, p.features, atol=2e-3)
    assert place_features(p, pixels, arm.joints) is p
    moved = place_features(p, pixels, arm.joints, np.arange(10) == 5)
    np.testing.assert_allclose(moved.features[5], p.features[5], atol=1e-6)
    blind = p.copy()
    blind.camera_translation[1] = np.nan
    placed = place_cameras(blind, arm.pixels, arm.joints, p.intrinsics)
    np.testing.assert_allclose(placed.camera_rotation, p.camera_rotation, atol=1e-5)
    np.testing.assert_allclose(placed.camera_translation, p.camera_translation, atol=1e-5)
    one = place_features(blind, arm.pixels, arm.joints, np.ones(10, bool))  # by the camera that is left
    np.testing.assert_allclose(one.features, p.features, atol=1e-5)
    for count in (3, 4):
        some = arm.pixels[:1].copy()
        some[:, 1, count:] = np.nan
        placed = place_cameras(blind, some, arm.joints[:1], p.intrinsics)
        assert np.isfinite(placed.camera_translation[1]).all() == (count == 4)


def opened(arm, free=None, weights=None, offsets=False, still=(), local="none"):
    p = arm.parameters
    free = free or Free(kinematics=True, features=True, cameras=np.array([False, True]), intrinsics=False)
    problem = PixelProblem(arm.pixels, p.links, 3, free, local, weights=weights)
    return describe_unobservable(problem, PixelState(p, arm.joints), offsets, list(still))


def test_what_is_seen_well_leaves_nothing_open(arm):
    assert opened(arm) == []
    assert opened(arm, offsets=True) == []
    assert opened(arm, still=[2]) == ["joint 2 did not move: its axis is unknown"]


def test_a_joint_that_does_not_move_is_named_once():
    assert opened(exact_arm(still=[2]), still=[3]) == ["joint 3 did not move: its axis is unknown"]


def test_features_that_are_seen_once_or_never_are_named(arm):
    weights = np.ones(arm.pixels.shape[:3])
    weights[:, :, 4] = 0.0
    weights[1:, :, 6] = 0.0
    weights[0, 0, 6] = 0.0
    weights[2:, :, 7] = 0.0
    weights[:2, 1, 7] = 0.0
    words = opened(arm, weights=0.3 * weights)
    assert words[:2] == [
        "feature 4 was seen in 0 usable images: its place is unknown",
        "feature 6 was seen in 1 usable images: its place is unknown",
    ]
    assert not any("feature 7 was" in word for word in words)
    assert "feature 6 is not determined by these observations" in words
    free = Free(kinematics=True, features=np.arange(10) != 0, cameras=np.array([False, True]), intrinsics=False)
    assert opened(arm, free)[0] == "feature 0 was seen in 28 usable images: its place is unknown"


def test_every_group_that_is_free_has_its_name_and_columns():
    """Of two joints, three features and two cameras, some of which are held."""
    columns = SimpleNamespace(
        axes=np.array([0, 2]),
        points=np.array([-1, 4]),
        features=np.array([6, -1, 9]),
        cameras=np.array([-1, 12]),
        intrinsics=np.array([18, -1]),
        intrinsics_count=4,
    )
    groups = [
        ("direction of joint 1", 0, 2),
        ("direction of joint 2", 2, 2),
        ("place of joint 2", 4, 2),
        ("feature 0", 6, 3),
        ("feature 2", 9, 3),
        ("pose of camera 1", 12, 6),
        ("intrinsics of camera 0", 18, 4),
    ]
    assert _groups(SimpleNamespace(columns=columns)) == groups
    held = np.full(3, -1)
    for name in (
        "axes",
        "points",
        "features",
        "cameras",
        "intrinsics",
    ):  # the first of its kind may be the first of all
        free = {"intrinsics_count": 4, **dict.fromkeys(("axes", "points", "features", "cameras", "intrinsics"), held)}
        found = _groups(SimpleNamespace(columns=SimpleNamespace(**{**free, name: np.array([-1, 0, -1])})))
        assert [first for _, first, _ in found] == [0]


def test_a_camera_that_sees_too_little_is_named(arm):
    weights = np.ones(arm.pixels.shape[:3])
    weights[:, 1, 2:] = 0.0
    weights[1:, 1] = 0.0
    words = opened(arm, weights=weights)
    assert "pose of camera 1 is not determined by these observations" in words
    assert not any("feature" in word for word in words)
    lens = Free(cameras=np.array([False, True]), intrinsics=np.array([False, True]), kinematics=True, features=True)
    assert "intrinsics of camera 1 is not determined by these observations" in opened(arm, lens, weights)


def test_mistaken_detections_lose_all_weight_and_the_others_get_theirs_back(arm):
    p = arm.parameters
    pixels = arm.pixels + 0.1 * np.random.default_rng(4).normal(size=arm.pixels.shape)
    pixels[2, 0, 3] += [30.0, -20.0]
    pixels[7, 1, 5] += [5.0, 5.0]
    weights = np.random.default_rng(5).uniform(0.3, 0.9, pixels.shape[:3])
    problem = PixelProblem(pixels, p.links, 3, Free(features=True), weights=weights)
    start = fitting.minimize(problem, PixelState(p, arm.joints), 20)
    found = fitting._reject(problem, start, fitting.FitOptions())
    assert problem.weights[2, 0, 3] == problem.weights[7, 1, 5] == 0.0
    kept = problem.weights > 0
    assert kept.sum() >= kept.size - 8
    assert (problem.weights[kept] == 1.0).all()
    np.testing.assert_allclose(found.state.parameters.features, p.features, atol=1e-3)
    assert found.iterations > start.iterations
    robust = relearning._robust(problem, PixelState(p, arm.joints))
    np.testing.assert_allclose(robust.state.parameters.features, p.features, atol=1e-3)
    assert problem.weights[2, 0, 3] == 0.0
    stage = fitting._stage("one", found, problem, 0.0, start)
    errors = problem.pixel_errors(found.state)[problem.weights > 0]
    assert stage.rms == pytest.approx(np.sqrt(np.mean(errors**2) / 2))
    assert (stage.initial_cost if hasattr(stage, "initial_cost") else start.initial_cost) == start.initial_cost
    assert stage.iterations == found.iterations + start.iterations
    assert fitting._stage("one", found, problem, 0.0).iterations == found.iterations


def test_features_that_are_seen_once_are_unknown(arm):
    weights = np.zeros(arm.pixels.shape[:3])
    weights[:, :, :4] = 0.5
    weights[0, 0, 4] = weights[0, 0, 5] = weights[1, 0, 5] = 0.5
    problem = PixelProblem(arm.pixels, arm.parameters.links, 3, Free(features=np.arange(10) > 0), weights=weights)
    found = fitting._without_unseen(arm.parameters, problem)
    assert np.isfinite(found.features[:, 0]).tolist() == [False, True, True, True, False, True] + [False] * 4
    assert np.isfinite(arm.parameters.features).all()
