"""A lens with one number: against OpenCV's distortion, its inverse, its derivatives, and far outside the image."""

import cv2
import numpy as np
import pytest

from dense_vs.body_model.lens import Lens

CENTER, FOCAL = np.array([159.5, 119.5]), 280.0
BENDS = [-0.12, -0.04, 0.0, 0.05, 0.12]


@pytest.fixture
def places():
    return np.random.default_rng(0).uniform([-20, -20], [340, 260], (200, 2))


@pytest.mark.parametrize("bend", BENDS)
def test_it_is_the_first_number_of_opencvs_distortion(places, bend):
    lens = Lens.of_center(CENTER, bend)
    assert lens.corner == pytest.approx(np.hypot(*CENTER))
    directions = np.column_stack([(places - CENTER) / FOCAL, np.ones(len(places))])
    k1 = bend * (FOCAL / lens.corner) ** 2
    camera = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
    expected, _ = cv2.projectPoints(directions, np.zeros(3), np.zeros(3), camera, np.array([k1, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(lens.bent(places), expected[:, 0], atol=1e-6)
    corner = lens.bent(np.zeros(2))
    np.testing.assert_allclose(corner, -bend * CENTER, atol=1e-9)


@pytest.mark.parametrize("bend", BENDS)
def test_straight_is_the_inverse(places, bend):
    lens = Lens.of_center(CENTER, bend)
    far = CENTER + np.array([[0.0, 0.0], [300.0, 100.0], [-4000.0, 3000.0], [1e6, 1e6]])
    for some in (places, far, places[None, :3]):
        np.testing.assert_allclose(lens.straight(lens.bent(some)), some, rtol=1e-7, atol=1e-6)
    assert np.isnan(lens.straight(np.full((2, 2), np.nan))).all()


@pytest.mark.parametrize("bend", BENDS)
def test_what_is_farther_out_is_seen_farther_out(bend):
    lens = Lens.of_center(CENTER, bend)
    away = lens.bent(CENTER + np.linspace(0, 5000, 2000)[:, None] * np.array([0.8, 0.6])) - CENTER
    assert (np.diff(np.linalg.norm(away, axis=1)) > 0).all()
    assert (away[1:] @ np.array([0.8, 0.6]) > 0).all()


@pytest.mark.parametrize("bend", BENDS)
def test_derivatives(places, bend):
    lens = Lens.of_center(CENTER, bend)
    some = np.vstack([places, [[900.0, -500.0]]])
    for k, step in enumerate(1e-4 * np.eye(2)):
        slope = (lens.bent(some + step) - lens.bent(some - step)) / 2e-4
        np.testing.assert_allclose(lens.slopes(some)[..., k], slope, atol=1e-6)


@pytest.mark.parametrize("bend", [-0.08, 0.05])
def test_straightened_images_are_those_of_a_pinhole(bend):
    """Each pixel's gray value says where a pinhole would see it."""
    lens = Lens.of_center(np.array([79.5, 59.5]), bend)
    x, y = np.meshgrid(np.arange(160), np.arange(120))
    column, row = np.moveaxis(lens.straight(np.stack([x, y], axis=-1).astype(float)), -1, 0)
    seen = [np.rint(np.clip(values, 0, 255)).astype(np.uint8) for values in (column, row)]
    for image, expected in zip(lens.straightened(seen), (x, y), strict=True):
        inside = np.s_[12:-12, 12:-12]
        np.testing.assert_allclose(image[inside].astype(float), expected[inside], atol=1.0)


def test_a_lens_that_does_not_bend_leaves_images_as_they_are():
    images = [np.zeros((4, 6), np.uint8)]
    assert Lens.of_center(np.array([2.5, 1.5])).straightened(images) is images
    assert Lens.of_center(np.array([2.5, 1.5]), 0.1).straightened([]) == []
