"""Where places and their surroundings are seen in other postures, beside hand-made turns."""

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo.body_features import BodyFeatures
from dense_vs.point_servo.turned_view import turned_view

FOCAL, CENTER = 100.0, np.array([160.0, 120.0])


def features(bend=0.0):
    """A hinge along the optical axis, and one on it that is upright and 2 before the camera."""
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    return BodyFeatures(Chain(axes, points, np.zeros(2), np.array([-1, 0])), FOCAL, CENTER, np.ones(2, bool), bend=bend)


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_what_turns_about_the_optical_axis_turns_in_the_image_by_as_much():
    pixels, seen_at = CENTER + np.array([[40.0, 10.0], [-20.0, 30.0], [0.0, -50.0]]), np.array([0.3, 0.0])
    postures = np.array([[0.3, 0.0], [1.0, 0.0], [-0.4, 0.0]])
    places, maps = turned_view(features(), pixels, np.array([1.0, 2.5, 4.0]), np.zeros(3, int), seen_at, postures)
    for t, posture in enumerate(postures):
        by = turn(posture[0] - seen_at[0])
        np.testing.assert_allclose(places[t], CENTER + (pixels - CENTER) @ by.T, atol=1e-9)
        np.testing.assert_allclose(maps[t], np.tile(by, (3, 1, 1)), atol=1e-9)


def test_each_place_goes_with_its_link_at_its_depth():
    pixels, depths = CENTER + np.array([[30.0, 0.0], [30.0, 0.0], [30.0, 0.0]]), np.array([2.0, 2.0, 1.5])
    links, angle = np.array([0, 1, 1]), 0.2
    places, maps = turned_view(features(), pixels, depths, links, np.zeros(2), np.array([[0.0, angle]]))
    np.testing.assert_allclose(places[0, 0], pixels[0], atol=1e-9)
    np.testing.assert_allclose(maps[0, 0], np.eye(2), atol=1e-9)
    for k in (1, 2):

        def seen(pixel, depth=depths[k]):
            x, y = (pixel - CENTER) / FOCAL * depth
            across, along = x * np.cos(angle) + (depth - 2) * np.sin(angle), (depth - 2) * np.cos(angle)
            z = 2 + along - x * np.sin(angle)
            return CENTER + FOCAL * np.array([across, y]) / z

        np.testing.assert_allclose(places[0, k], seen(pixels[k]), atol=1e-9)
        beside = [seen(pixels[k] + step) - seen(pixels[k]) for step in np.eye(2)]
        np.testing.assert_allclose(maps[0, k], np.transpose(beside), atol=1e-9)


def test_where_it_was_seen_it_is_seen_through_any_lens():
    pixels = CENTER + np.array([[140.0, 90.0], [-130.0, 20.0]])
    posture = np.array([0.2, -0.3])
    places, maps = turned_view(features(-0.05), pixels, np.array([2.0, 3.0]), np.array([1, 0]), posture, posture[None])
    np.testing.assert_allclose(places[0], pixels, atol=1e-6)
    np.testing.assert_allclose(maps[0], np.tile(np.eye(2), (2, 1, 1)), atol=1e-6)


def test_a_surface_that_is_aslant_is_seen_as_it_turns():
    """Around a pixel the logarithm of the depth grows by its slope; turned about the upright hinge by hand."""
    pixel, depth, slope, angle = CENTER + np.array([10.0, -20.0]), 2.2, np.array([0.004, -0.002]), 0.5

    def seen(away):
        z = depth * np.exp(slope @ away)
        x, y = (pixel + away - CENTER) / FOCAL * z
        turned = x * np.cos(angle) + (z - 2) * np.sin(angle), y, 2 + (z - 2) * np.cos(angle) - x * np.sin(angle)
        return CENTER + FOCAL * np.array(turned[:2]) / turned[2]

    postures = np.array([[0.0, angle]])
    at = pixel[None], np.array([depth]), np.array([1]), np.zeros(2), postures
    places, maps = turned_view(features(), *at, slope[None])
    expected = np.transpose([seen(step) - seen(np.zeros(2)) for step in np.eye(2)])
    np.testing.assert_allclose(places[0, 0], seen(np.zeros(2)), atol=1e-9)
    np.testing.assert_allclose(maps[0, 0], expected, atol=1e-9)
    facing = turned_view(features(), *at)[1]
    assert np.abs(facing[0, 0] - expected).max() > 0.1
