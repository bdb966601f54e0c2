"""Candidates, paths and poses beside brute force: which explain an image, which is taken, where one begins to look."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from exact_arm import exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.generative.inference import joint_inference, pose_inference
from dense_vs.generative.inference.joint_inference import Inference, JointInference, likely_paths
from dense_vs.generative.inference.pose_inference import PoseInference, infer_poses


@pytest.mark.parametrize("seed", range(4))
def test_paths_are_the_best_of_all_for_each_end(seed):
    rng = np.random.default_rng(seed)
    candidates = [0.3 * rng.normal(size=(k, 2)) for k in (3, 1, 4, 2, 3)]
    penalties = [3 * rng.random(len(some)) for some in candidates]
    actions = 0.3 * rng.normal(size=(4, 2))

    def cost(path):
        total = sum(penalties[t][k] for t, k in enumerate(path))
        for t in range(4):
            off = candidates[t + 1][path[t + 1]] - candidates[t][path[t]] - actions[t]
            total += np.sum(off**2) / 0.15**2
        return total

    every = list(product(*(range(len(some)) for some in candidates)))
    ends = [min((path for path in every if path[-1] == k), key=cost) for k in range(3)]
    expected = sorted(ends, key=cost)
    found = likely_paths(candidates, penalties, actions, 0.15)
    assert len(found) == 3
    for path, one in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, [candidates[t][k] for t, k in enumerate(path)])


@pytest.fixture
def arm():
    return exact_arm(samples=12)


def inference(arm, sigma=0.5, starts=8):
    return JointInference(arm.parameters, arm.joints, sigma, starts)


def test_what_an_inference_knows_beforehand(arm):
    one = inference(arm)
    np.testing.assert_array_equal(one.memory, np.vstack([arm.parameters.home, arm.joints]))
    off = arm.joints - arm.joints.mean(axis=0)
    expected = np.linalg.inv(4 * off.T @ off / 11 + 0.01 * np.eye(3))
    np.testing.assert_allclose(one.precision, expected)
    assert (one.starts, inference(arm, starts=99).starts) == (8, 13)
    assert (one.pixel_sigma, inference(arm, 0.01).pixel_sigma) == (0.5, 0.1)
    alone = JointInference(arm.parameters, arm.joints[:0], 0.5)
    np.testing.assert_allclose(alone.precision, 100 * np.eye(3))
    two = JointInference(arm.parameters, arm.joints[:2], 0.5)
    assert not np.allclose(two.precision, 100 * np.eye(3))


def test_one_begins_at_the_postures_whose_images_are_nearest(arm):
    arm.parameters.features[3] = np.nan  # of which nothing is known
    one = inference(arm, starts=4)
    one.images[6, 0, 2] = np.nan  # behind a camera there
    image = arm.pixels[[4, 9]].copy()
    image[1, 0, :5] = np.nan
    expected = []
    for own in image:
        distance = []
        for k in range(13):
            off = np.abs(one.images[k] - own).sum(axis=-1)[np.isfinite(own[..., 0])]
            distance.append(np.mean(np.where(np.isfinite(off), off, 1e4)))
        expected.append(one.memory[np.argsort(distance)[:4]])
    found = one._nearest(image)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(found[:, 0], arm.joints[[4, 9]])


@pytest.mark.parametrize("near", [None, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_what_explains_an_image_and_what_is_taken(arm, near, seed):
    """Costs up to four times the best one's with the noise; joints 0.05 rad apart; the likeliest, or the nearest."""
    rng = np.random.default_rng(seed)
    one = inference(arm)
    pixels = arm.pixels[:2].copy()
    pixels[0, 1, 2:9] = np.nan
    joints = arm.joints[:2, None] + rng.choice([0.0, 0.04, 0.06, 0.5, -0.7], (2, 9, 3))
    costs = rng.uniform(0.0, 90.0, (2, 9))
    given = None if near is None else arm.joints[:2] + near
    found = one._choose(joints, costs, pixels, given)
    for t in range(2):
        count = 2 * np.isfinite(pixels[t, ..., 0]).sum()
        limit = 4.0 * (costs[t].min() + 0.25 * count)
        kept = []
        for k in np.argsort(costs[t]):
            alike = any(np.abs(joints[t, k] - joints[t, other]).max() <= 0.05 for other in kept)
            if costs[t, k] <= limit and not alike:
                kept.append(k)
        np.testing.assert_array_equal(found.candidates[t], joints[t, kept])

        def doubt(k, t=t):
            if given is not None:
                return np.abs(joints[t, k] - given[t]).max()
            away = joints[t, k] - arm.parameters.home
            return costs[t, k] / 0.25 + away @ one.precision @ away

        best = min(kept, key=doubt)
        np.testing.assert_array_equal(found.joints[t], joints[t, best])
        assert found.rms_px[t] == pytest.approx(np.sqrt(costs[t, best] / count))


def test_costs_beyond_four_times_the_best_explain_nothing(arm):
    one = inference(arm)
    joints = arm.joints[:1, None] + np.array([0.0, 1.0, 2.0])[:, None]
    noise = 0.25 * 2 * 20
    for cost, kept in ((4 * (2.0 + noise) - 0.01, 2), (4 * (2.0 + noise) + 0.01, 1)):
        found = one._choose(joints, np.array([[2.0, cost, 1e9]]), arm.pixels[:1], None)
        assert len(found.candidates[0]) == kept
    blind = one._choose(joints, np.array([[0.0, 1.9, 2.1]]), np.full((1, 2, 10, 2), np.nan), None)
    assert len(blind.candidates[0]) == 2  # as if one feature had been seen


@pytest.mark.parametrize(
    ("rms", "sigma", "again"), [(2.9, 0.4, False), (3.1, 0.4, True), (5.9, 1.0, False), (6.1, 1.0, True)]
)
def test_what_is_lost_near_a_posture_is_sought_everywhere(arm, monkeypatch, rms, sigma, again):
    """Above 3 px or six times the noise; the others stay as they are."""
    one = inference(arm, sigma)
    asked = []

    def solve(pixels, starts, robust_scale):
        asked.append((len(pixels), starts.shape[1], robust_scale))
        return starts, np.zeros(starts.shape[:2])

    def choose(joints, costs, pixels, near):
        first = len(asked) == 1
        errors = np.array([0.5, rms]) if first else np.array([0.1])
        return Inference(
            joints[:, 0] + len(asked), errors[: len(joints)], [f"{len(asked)}{k}" for k in range(len(joints))]
        )

    monkeypatch.setattr(one, "_solve", solve)
    monkeypatch.setattr(one, "_choose", choose)
    near = arm.joints[:2]
    found = one(arm.pixels[:2], near, robust=True)
    assert asked == [(2, 1, 4 * sigma), (1, 9, 4 * sigma)][: 1 + again]
    np.testing.assert_allclose(found.joints, [near[0] + 1, near[1] + (2 if again else 1)])
    assert found.candidates == ["10", "20" if again else "11"]
    assert found.rms_px[1] == (0.1 if again else rms)
    asked.clear()
    one(arm.pixels[:2])
    assert asked == [(2, 8, 0.0)]


def test_a_sequence_looks_where_the_actions_lead(arm, monkeypatch):
    one = inference(arm, 0.5, starts=4)
    actions = np.diff(arm.joints[:4], axis=0)
    asked, paths = [], []
    solve = one._solve

    def kept(pixels, starts, robust_scale):
        asked.append(starts)
        assert robust_scale == 2.0
        return solve(pixels, starts, robust_scale)

    def likely(candidates, penalties, steps, tolerance):
        paths.append((candidates, penalties, tolerance))
        return [np.full((4, 3), float(k)) for k in range(7)]

    tried = []
    monkeypatch.setattr(one, "_solve", kept)
    monkeypatch.setattr(joint_inference, "likely_paths", likely)

    def smooth(parameters, pixels, path, steps, information):
        tried.append((path[0, 0], information))
        return path, [3, 1, 2, 0.5, 0][len(tried) - 1]

    monkeypatch.setattr(joint_inference, "smooth", smooth)
    found = one.sequence(arm.pixels[:4], actions, 7.0, robust=True)
    assert tried == [(0.0, 7.0), (1.0, 7.0), (2.0, 7.0), (3.0, 7.0)]
    assert found[0, 0] == 3.0
    candidates, penalties, tolerance = paths[0]
    assert tolerance == 0.1
    assert [starts.shape[1] for starts in asked[::2]] == [4] + [4 + len(some) for some in candidates[:-1]]
    np.testing.assert_allclose(asked[2][0, 4:], candidates[0] + actions[0])
    for t, (some, penalty) in enumerate(zip(candidates, penalties, strict=True)):
        off = (project(arm.parameters, some) - arm.pixels[t]) ** 2
        assert penalty.shape == (len(some),)
        assert penalty[0] == pytest.approx(off[0].sum() / 0.25, abs=1e-3)


# Poses of the hand.


def posed(arm, count=5, seed=0):
    rng = np.random.default_rng(seed)
    p = replace(arm.parameters, links=np.full(10, 3))
    rotation = Rotation.from_rotvec(0.5 * rng.normal(size=(count, 3))).as_matrix()
    translation = 0.2 * rng.normal(size=(count, 3))
    world = np.einsum("tij,mj->tmi", rotation, p.features) + translation[:, None]
    seen = np.einsum("cij,tmj->tcmi", p.camera_rotation, world) + p.camera_translation[:, None]
    return (
        p,
        rotation,
        translation,
        seen[..., :2] / seen[..., 2:] * p.intrinsics[:, None, :2] + p.intrinsics[:, None, 2:4],
    )


def test_poses_of_exact_images(arm):
    p, rotation, translation, pixels = posed(arm)
    pixels[1, 0, 3:] = np.nan
    pixels[2, :, 3:] = np.nan  # three features place no hand
    pixels[3, 1] = np.nan
    hand = np.arange(10) != 9
    pixels[:, :, 9] += 90.0  # not of the hand
    found = infer_poses(p, pixels, hand)
    kept = [0, 1, 3, 4]
    np.testing.assert_allclose(found[0][kept], rotation[kept], atol=1e-4)
    np.testing.assert_allclose(found[1][kept], translation[kept], atol=1e-4)
    assert np.isnan(found[1][2]).all()
    assert np.isnan(found[2][2])
    assert found[2][kept].max() < 1e-2
    blind = infer_poses(p, np.full((1, 2, 10, 2), np.nan), hand)
    assert np.isnan(blind[1]).all()
    noise = np.random.default_rng(1).normal(size=pixels.shape)
    noisy = infer_poses(p, pixels + noise, hand)
    world = np.einsum("tij,mj->tmi", noisy[0], p.features) + noisy[1][:, None]
    seen = np.einsum("cij,tmj->tcmi", p.camera_rotation, world) + p.camera_translation[:, None]
    made = seen[..., :2] / seen[..., 2:] * p.intrinsics[:, None, :2] + p.intrinsics[:, None, 2:4]
    off = (made - pixels - noise)[:, :, hand]
    for t in kept:
        assert noisy[2][t] == pytest.approx(np.sqrt(np.nanmean(off[t] ** 2)), rel=1e-3)


def test_known_poses_whose_images_are_nearest_are_starts(arm):
    p, rotation, translation, pixels = posed(arm, 8, 2)
    one = PoseInference(p, np.ones(10, bool), (rotation, translation))
    some = pixels[[5, 1]].copy()
    some[0, 0, :4] = np.nan
    np.testing.assert_allclose(one._images, pixels, atol=1e-6)
    one._images[3, 0, 6] = np.nan
    expected = []
    for own in some:
        seen = np.isfinite(own[..., 0])
        distance = [np.abs(one._images[k] - own).sum(axis=-1)[seen] for k in range(8)]
        order = np.argsort([np.mean(np.where(np.isfinite(d), d, 1e4)) for d in distance])
        expected.append(order[:3])
    np.testing.assert_array_equal(one._nearest(some), expected)
    asked = []
    refine = one._refine
    one._refine = lambda pixels, rotation, translation: (
        asked.append(translation) or refine(pixels, rotation, translation)
    )
    found = one(some)
    np.testing.assert_allclose(found[1], translation[[5, 1]], atol=1e-4)
    np.testing.assert_allclose(asked[0][:, 1:], translation[np.array(expected)])
    assert asked[0].shape == (2, 4, 3)
    few = PoseInference(p, np.ones(10, bool), (rotation[:2], translation[:2]))
    assert few._nearest(some).shape == (2, 2)
    assert PoseInference(p, np.ones(10, bool), (rotation[:0], translation[:0]))._known is None


@pytest.mark.parametrize(("error", "asked"), [(2.0, [0]), (4.0, [0, 1])])
def test_another_camera_is_asked_where_the_one_that_sees_most_explains_too_little(arm, monkeypatch, error, asked):
    """A median error of 3 px over all cameras."""
    p, rotation, translation, pixels = posed(arm, 1, 4)
    pixels[0, 1, 0] = np.nan
    pixels[0, :, :, 0] += error
    order = []

    def resect(points, flat):
        order.append(0 if len(points) == 10 else 1)
        camera = order[-1]
        turn = p.camera_rotation[camera]
        return turn @ rotation[0], turn @ translation[0] + p.camera_translation[camera]

    monkeypatch.setattr(pose_inference, "resect", resect)
    found = PoseInference(p, np.ones(10, bool))._first_poses(pixels)
    assert order == asked
    np.testing.assert_allclose(found[0][0], rotation[0], atol=1e-12)
    np.testing.assert_allclose(found[1][0], translation[0], atol=1e-12)
    monkeypatch.setattr(pose_inference, "resect", lambda points, flat: None)
    assert np.isnan(PoseInference(p, np.ones(10, bool))._first_poses(pixels)[1]).all()
