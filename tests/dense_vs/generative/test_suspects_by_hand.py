"""Detections that are mistakes, how far images are from a model, and stored links, each by hand."""

import numpy as np
import pytest
from exact_arm import SIZES, carried, exact_arm, project
from scipy.spatial.transform import Rotation

from dense_vs.errors import DenseVSError
from dense_vs.generative import GenerativeModel
from dense_vs.generative.least_squares.outliers import list_outliers, mistaken, robust_sigma
from dense_vs.generative.report import FitReport, Outlier

MODELED = np.array([[100.0, 50.0], [200.0, 50.0], [300.0, 80.0], [310.0, 85.0]])


def listed(moves, mask, sigma):
    """Of one image of one camera, sample 2 of camera 1, whose features have been moved."""
    pixels, modeled = np.zeros((3, 2, 4, 2)), np.zeros((3, 2, 4, 2))
    modeled[2, 1] = MODELED
    pixels[2, 1] = moves
    whole = np.zeros((3, 2, 4), bool)
    whole[2, 1] = mask
    return list_outliers(pixels, modeled, whole, sigma)


@pytest.mark.parametrize(("sigma", "limit"), [(1.0, 6.0), (0.5, 3.0), (1 / 3, 2.0), (0.1, 2.0)])
def test_a_detection_is_mistaken_from_six_sigma_and_two_pixels_on(sigma, limit):
    errors = np.array([0.0, limit - 0.01, limit + 0.01, np.nan])
    assert mistaken(errors, sigma).tolist() == [False, False, True, False]


def test_noise_by_the_median_of_distances():
    errors = np.hypot(*np.random.default_rng(0).normal(0, 0.7, (2, 20000)))
    errors[:3000:2] = np.nan
    assert robust_sigma(errors) == pytest.approx(0.7, rel=0.02)
    assert robust_sigma(np.array([2.0, 1.0, np.nan, 9.0])) == pytest.approx(2.0 / 1.1774)
    assert np.isnan(robust_sigma(np.full(3, np.nan)))


def test_outliers_are_listed_with_their_errors():
    moves = np.add(MODELED, [[3.0, 4.0], [0.0, 0.0], [30.0, -40.0], [0.0, 9.0]])
    outliers, swapped = listed(moves, [True, False, True, False], 0.5)
    assert outliers == [Outlier(2, 1, 0, 5.0), Outlier(2, 1, 2, 50.0)]
    assert swapped == []


@pytest.mark.parametrize(
    ("first", "second", "exchanged"),
    [((0.0, 0.0), (0.0, 0.0), True), ((2.9, 0.0), (0.0, -2.9), True), ((3.1, 0.0), (0.0, 0.0), False),
     ((0.0, 0.0), (0.0, 3.1), False), ((3.1, 0.0), (0.0, 3.1), False)],
)  # fmt: skip
def test_labels_are_exchanged_where_both_fit_the_other_s_place(first, second, exchanged):
    """Within six times half a pixel of noise."""
    moves = MODELED[[2, 1, 0, 3]] + [first, (0.0, 0.0), second, (40.0, 0.0)]
    outliers, swapped = listed(moves, [True, False, True, True], 0.5)
    assert [one.feature for one in outliers] == [0, 2, 3]
    assert swapped == ([(2, 1, 0, 2)] if exchanged else [])


def test_how_far_images_are_from_a_model():
    arm = exact_arm(samples=3)
    model = GenerativeModel(arm.parameters, arm.joints, FitReport(), image_sizes=SIZES)
    errors = np.random.default_rng(0).normal(size=arm.pixels.shape)
    pixels = project(arm.parameters, arm.joints) + errors
    pixels[1, 0, 3:7] = np.nan
    pixels[2] = np.nan
    expected = [np.sqrt(np.mean(errors[0] ** 2)), np.sqrt(np.mean(errors[1][np.isfinite(pixels[1])] ** 2)), 0.0]
    np.testing.assert_allclose(model.misfit_px(pixels, arm.joints), expected, atol=1e-9)
    arm.parameters.features[2] = np.nan  # of what the model does not know an image says nothing
    errors[:, :, 2] = 0.0
    pixels[:, :, 2] += 99.0
    known = np.isfinite(pixels) & (np.arange(10) != 2)[:, None]
    expected = [np.sqrt((errors[t] ** 2)[known[t]].mean()) if known[t].any() else 0.0 for t in range(3)]
    np.testing.assert_allclose(model.misfit_px(pixels, arm.joints), expected, atol=1e-9)
    arm.parameters.features[4] = [0.0, 0.0, -30.0]  # behind a camera it cannot have been seen
    assert model.misfit_px(pixels[:1], arm.joints[:1]).tolist() == [np.inf]
    with pytest.raises(DenseVSError, match="state is of 2 images; expected 3, as pixels"):
        model.misfit_px(pixels, arm.joints[:2])


def test_how_far_images_are_from_poses():
    arm = exact_arm(samples=2)
    arm.parameters.links[:] = 3
    model = GenerativeModel(arm.parameters, arm.joints, FitReport(), image_sizes=SIZES, controller="cartesian")
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, :3, :3] = Rotation.from_rotvec([0.1, -0.2, 0.05]).as_matrix()
    poses[1, :3, 3] = [0.02, 0.05, -0.03]
    p = arm.parameters
    world = np.einsum("tij,mj->tmi", poses[:, :3, :3], p.features) + poses[:, None, :3, 3]
    seen = np.einsum("cij,tmj->tcmi", p.camera_rotation, world) + p.camera_translation[:, None]
    pixels = seen[..., :2] / seen[..., 2:] * p.intrinsics[:, None, :2] + p.intrinsics[:, None, 2:4]
    np.testing.assert_allclose(model.misfit_px(pixels, poses), 0.0, atol=1e-9)
    np.testing.assert_allclose(model.misfit_px(np.add(pixels, [3.0, 0.0]), poses), 3.0 / np.sqrt(2))


@pytest.mark.parametrize("link", [-1, 4])
def test_a_stored_feature_on_a_link_that_is_none(tmp_path, link):
    arm = exact_arm(samples=3)
    model = GenerativeModel(arm.parameters, arm.joints, FitReport(), image_sizes=SIZES)
    for links in ([0, 1, 2, 3] + [3] * 6, [3] * 9 + [link]):
        arm.parameters.links = np.array(links)
        model.save(tmp_path / "model.npz")
        if link in links:
            with pytest.raises(DenseVSError, match="expected 0 to 3, the joints"):
                GenerativeModel.load(tmp_path / "model.npz")
        else:
            assert GenerativeModel.load(tmp_path / "model.npz").parameters.links.tolist() == links


def test_poses_of_the_hand_at_the_postures_learned_from():
    arm = exact_arm(samples=4)
    model = GenerativeModel(arm.parameters, arm.joints, FitReport(), image_sizes=SIZES)
    turns, places = model._known_poses()
    for q, turn, place in zip(arm.joints, turns, places, strict=True):
        for point in np.eye(3):
            np.testing.assert_allclose(turn @ point + place, carried(arm.parameters, q, 3, point), atol=1e-12)
    poses = np.random.default_rng(0).normal(size=(4, 4, 4))
    told = GenerativeModel(arm.parameters, arm.joints, FitReport(), image_sizes=SIZES, poses=poses)._known_poses()
    np.testing.assert_array_equal(told[0], poses[:, :3, :3])
    np.testing.assert_array_equal(told[1], poses[:, :3, 3])
