"""Points are looked for where a chain has them in an image wider than high, and taken where they look alike."""

import cv2
import numpy as np
import pytest

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.corners import Corners
from dense_vs.body_model.image_directions import direction_weights
from dense_vs.body_model.sought_points import BORDER, FARTHEST, SoughtPoints
from dense_vs.body_model.track_problem import BodyState

SIZE, FOCAL = (90, 160), 150.0
CENTER = np.array([79.5, 44.5])
ANGLE = 0.06  # rad
AT = np.array([[30.0, 30.0], [60.0, 60.0], [100.0, 40.0], [130.0, 50.0], [140.0, 25.0]])
CHAIN = Chain(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)), np.zeros(1), np.array([-1]))


def textured(seed):
    random = np.random.default_rng(seed).normal(0, 1, SIZE)
    smooth = cv2.GaussianBlur(random, (0, 0), 1.5)
    return np.clip(128 + 55 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def turned(angle, shift=0.0):
    """The plane before the camera after the joint, which is the optical axis, has turned; shifted to the right [px]."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s], [s, c]])
    moved = np.column_stack([rotation, CENTER - rotation @ CENTER + (shift, 0.0)])
    return cv2.warpAffine(textured(1), moved, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def turned_places(angle):
    c, s = np.cos(angle), np.sin(angle)
    return CENTER + (AT - CENTER) @ np.array([[c, -s], [s, c]]).T


def sought(image, every=1, rows=2):
    """Places and directions of points of the first image, sought in others that are all this one."""
    images = [textured(1)] + [image] * (rows - 1)
    points = SoughtPoints(images, np.array([[0.0]] + [[ANGLE]] * (rows - 1)), tuple(CENTER))
    there = np.column_stack([(AT - CENTER) / FOCAL, np.ones(len(AT))])
    points.add(Corners(AT, np.zeros(len(AT), int), there), 0)
    return points.places(BodyState(CHAIN, points.points, FOCAL), every)


def test_points_are_found_where_the_chain_has_them_all_over_the_image():
    image = turned(ANGLE)
    places, directions = sought(image)
    assert (AT[:, 0] > SIZE[0]).any()
    np.testing.assert_allclose(places[0], AT)
    np.testing.assert_allclose(places[1], turned_places(ANGLE), atol=0.15)
    np.testing.assert_allclose(directions[1], direction_weights(image, places[1]))


@pytest.mark.parametrize(("shift", "seen"), [(FARTHEST - 0.6, True), (FARTHEST + 0.6, False)])
def test_what_looks_alike_too_far_away_is_another_place(shift, seen):
    places, _ = sought(turned(ANGLE, shift))
    assert np.isfinite(places[1]).all() == seen
    assert np.isnan(places[1]).all() != seen


def test_what_looks_otherwise_is_not_seen():
    places, directions = sought(textured(2))
    assert np.isnan(places[1]).all()
    assert not directions[1].any()


def test_images_in_between_are_left_out():
    places, _ = sought(turned(ANGLE), every=2, rows=4)
    assert [bool(np.isfinite(row).all()) for row in places] == [True, False, True, False]


def test_at_the_border_nothing_is_sought():
    edge = SIZE[1] - 1 - BORDER
    at = np.array([[edge + 0.5, 44.5], [edge - 3.0, 44.5], [BORDER - 0.5, 44.5], [BORDER + 3.0, 44.5]])
    points = SoughtPoints([textured(1), textured(1)], np.zeros((2, 1)), tuple(CENTER))
    points.add(Corners(at, np.zeros(4, int), np.column_stack([(at - CENTER) / FOCAL, np.ones(4)])), 0)
    places, _ = points.places(BodyState(CHAIN, points.points, FOCAL), 1)
    np.testing.assert_array_equal(np.isfinite(places[1]).all(axis=1), [False, True, False, True])
    np.testing.assert_allclose(places[1, 1::2], at[1::2], atol=0.1)
