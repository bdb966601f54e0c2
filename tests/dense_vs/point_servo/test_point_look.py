"""A look is found again where an image was turned, sheared and shifted exactly; what cannot be told is not made up."""

import cv2
import numpy as np
import pytest

from dense_vs.point_servo.point_look import PointLook

POINT, SIZE, WINDOW = np.array([60.0, 50.0]), (128, 96), 25
TURN = 0.4
AFFINE = np.array([[np.cos(TURN), -1.1 * np.sin(TURN)], [np.sin(TURN), 0.8 * np.cos(TURN)]])
WIDE = 9.0 * np.eye(2)  # px^2


def texture(seed=0):
    rough = np.random.default_rng(seed).normal(size=SIZE[::-1])
    smooth = cv2.GaussianBlur(rough, (0, 0), 2.0)
    return np.clip(128 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def moved(gray, place):
    """The image, so that what is about POINT lies about a place, mapped by AFFINE."""
    matrix = np.column_stack([AFFINE, place - AFFINE @ POINT])
    return cv2.warpAffine(gray, matrix, SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize("off", [(0.0, 0.0), (3.3, -2.6), (-4.7, 1.4)])
def test_it_is_found_where_it_is(off):
    gray, place = texture(), np.array([70.3, 44.6])
    look = PointLook(gray, POINT, None, WINDOW)
    found, correlation = look.found(moved(gray, place), place + off, AFFINE, WIDE)
    assert np.linalg.norm(found - place) < 0.3  # drawn a little to where it is expected
    assert correlation > 0.97


def test_only_pixels_of_the_same_surface_count():
    gray, place = texture(), np.array([64.0, 47.0])
    same = np.zeros(gray.shape, bool)
    same[:, :62] = True
    later = np.where(cv2.warpAffine(same.astype(np.uint8), np.array([[1.0, 0, 4], [0, 1, -3]]), SIZE) > 0,
                     np.roll(gray, (-3, 4), (0, 1)), texture(1))  # fmt: skip
    found, correlation = PointLook(gray, POINT, same, WINDOW).found(later, POINT, np.eye(2), WIDE)
    assert np.linalg.norm(found - place) < 0.3
    assert correlation > 0.9
    assert PointLook(gray, POINT, None, WINDOW).found(later, place, np.eye(2), WIDE)[1] < correlation - 0.1


def test_along_an_edge_it_stays_where_it_is_expected():
    gray = np.where(np.arange(SIZE[0]) < 58, 60, 180).astype(np.uint8) * np.ones((SIZE[1], 1), np.uint8)
    later = np.roll(gray, 4, axis=1)
    found, _ = PointLook(gray, POINT, None, WINDOW).found(later, POINT + np.array([1.0, 2.0]), np.eye(2), WIDE)
    assert abs(found[0] - (POINT[0] + 4)) < 0.3  # across the edge, by the image
    assert abs(found[1] - (POINT[1] + 2)) < 0.3  # along it, by the expectation


def test_what_it_may_be_off_by_decides_between_two_that_are_alike():
    gray = texture()
    later = gray.copy()
    patch = gray[35:66, 45:76]
    later[35:66, 61:92], later[35:66, 29:60] = patch, patch  # 16 px to the right, and to the left
    thin = np.diag([36.0, 1.0])
    for side in (-1, 1):
        found, _ = PointLook(gray, POINT, None, 17).found(later, POINT + np.array([side * 11.0, 0]), np.eye(2), thin)
        assert abs(found[0] - (POINT[0] + side * 16)) < 0.5


def test_what_covers_it_is_not_taken_for_it():
    _, correlation = PointLook(texture(), POINT, None, WINDOW).found(texture(2), POINT, AFFINE, WIDE)
    assert correlation < 0.6


@pytest.mark.parametrize(
    ("expected", "affine"),
    [
        ([-5.0, 40.0], np.eye(2)),
        ([60.0, 96.0], np.eye(2)),
        ([np.nan, 40.0], np.eye(2)),
        ([60.0, 50.0], np.full((2, 2), np.nan)),
        ([60.0, 50.0], np.diag([1.0, 0.1])),  # seen from the side
        ([60.0, 50.0], np.diag([4.0, 1.0])),
    ],
)
def test_where_it_cannot_be_seen(expected, affine):
    look = PointLook(texture(), POINT, None, WINDOW)
    found, correlation = look.found(texture(), np.array(expected), affine, WIDE)
    assert correlation == -1
    np.testing.assert_array_equal(found, expected)


def test_a_plain_surface_has_no_look():
    plain = np.full(SIZE[::-1], 90, np.uint8)
    assert PointLook(plain, POINT, None, WINDOW).found(texture(), POINT, np.eye(2), WIDE)[1] == -1
    assert abs(PointLook(texture(), POINT, None, WINDOW).found(plain, POINT, np.eye(2), WIDE)[1]) < 0.1


@pytest.mark.parametrize("window", [25, 11])
def test_a_surface_that_is_plain_but_for_rounding_has_no_look(window):
    """A gray level's step was taken for any other one, with correlations above 1."""
    gray, later = np.full((2, *SIZE[::-1]), 90, np.uint8)
    gray[:, 62:] = 91
    later[:40], later[:, 90:], later[60, 66], later[55, 55:58] = 200, 10, 91, 91
    look = PointLook(gray, POINT, None, window)
    seen = look.seen(later, POINT + 2.0, np.eye(2), WIDE)
    assert seen.correlation == -1
    np.testing.assert_array_equal(seen.place, POINT + 2.0)


def test_a_place_that_is_plain_but_for_rounding_is_not_like_a_look():
    gray = texture()
    later = np.full_like(gray, 90)
    later[:, :35] = 220
    later[50, 64] = 91
    _, correlation = PointLook(gray, POINT, None, 11).found(later, POINT + 2.0, np.eye(2), WIDE)
    assert abs(correlation) < 0.2


def test_where_only_the_middle_is_of_the_same_plane_it_is_seen_by_that():
    """Around 15 px of the surface that the point is on lies another, which is elsewhere by now."""
    gray, there = texture(), POINT + np.array([2.0, 1.0])
    y, x = np.mgrid[: gray.shape[0], : gray.shape[1]]
    own = np.maximum(abs(x - there[0]), abs(y - there[1])) <= 7
    later = np.where(own, np.roll(gray, (1, 2), axis=(0, 1)), texture(7)).astype(np.uint8)
    look = PointLook(gray, POINT, None, 25)
    assert look.found(later, POINT, np.eye(2), WIDE)[1] < 0.8
    seen = look.seen(later, POINT, np.eye(2), WIDE)
    np.testing.assert_allclose(seen.place, there, atol=0.2)
    assert seen.as_expected
    assert seen.correlation > 0.9
    assert seen.drift == look.middle.drift(seen.correlation)
    small = PointLook(gray, POINT, None, 11)
    assert small.middle is None
    assert look.middle.found(later, POINT, np.eye(2), WIDE)[1] == small.found(later, POINT, np.eye(2), WIDE)[1]
