"""A point by its link: its depth by a body model's surface, what features about it are off, postures for it."""

import numpy as np
import pytest

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo import point_on_link
from dense_vs.point_servo.body_features import BodyFeatures, FeatureState, Keyframe
from dense_vs.point_servo.place_errors import PlaceErrors
from dense_vs.point_servo.point_depth import PointDepth, witnessed
from dense_vs.point_servo.point_on_link import POINT, PointOnLink
from dense_vs.point_servo.surface_place import SurfacePlace

FOCAL, CENTER = 300.0, np.array([159.5, 119.5])
PIXEL = np.array([100.0, 80.0])


def features_at(depths):
    """The point, and features on link 0 at depths in its image: 40 px and more away from it."""
    chain = Chain(np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 2.0]]), np.zeros(1), np.array([-1]))
    features = BodyFeatures(chain, FOCAL, CENTER, np.array([True]))
    features.added(1 + len(depths))
    places = PIXEL + np.column_stack([40.0 + 9 * np.arange(len(depths)), np.zeros(len(depths))])
    rays = np.column_stack([(places - CENTER) / FOCAL, np.ones(len(depths))])
    features.points[1:] = rays * np.reshape(depths, (-1, 1))
    features.links[:] = 0
    features.states[1:] = FeatureState.KNOWN
    features.keyframes = [Keyframe(np.zeros(1), np.zeros(0, int), np.zeros((0, 2)), np.zeros((240, 320), np.uint8))]
    return features


def placed(features, surface, plain=0.0):
    point = PointOnLink(features, PIXEL, np.zeros(1), surface and SurfacePlace(*surface), plain)
    point.place(np.arange(len(features)))
    return point


def test_without_features_the_surface_tells_the_depth():
    features = features_at([])
    found = placed(features, (0, 1.7)).depth
    assert (found.depth, found.deviation) == pytest.approx((1.7, 0.015), rel=1e-3)
    assert features.states[POINT] == FeatureState.KNOWN
    np.testing.assert_allclose(features.project(np.array([POINT]), np.zeros(1))[0], PIXEL)
    assert placed(features_at([]), None).depth is None
    assert placed(features_at([]), (1, 1.7)).depth is None  # another link's


def test_features_and_surface_count_by_how_near_features_are():
    for depths, surface in (([2.0, 2.0, 2.0], 1.9), ([2.0, 2.0, 2.0], 2.1)):
        by_features = np.hypot(0.03, 0.0015 * 40)
        share = 0.015**-2 / (0.015**-2 + by_features**-2)
        found = placed(features_at(depths), (0, surface)).depth
        assert np.log(found.depth / 2.0) == pytest.approx(share * np.log(surface / 2.0), abs=0.002)
        assert found.deviation == pytest.approx((0.015**-2 + by_features**-2) ** -0.5, rel=0.02)


@pytest.mark.parametrize("plain", [0.0, 0.3, 1.0])
def test_where_the_image_is_plain_all_that_tells_the_depth_has_it_too_far(plain):
    """By 0.5 % of what the surface says, 4 % of what features say, and 3.7 % of the point's own places."""
    assert np.log(placed(features_at([]), (0, 1.7), plain).depth.depth / 1.7) == pytest.approx(-0.005 * plain, abs=2e-4)
    assert np.log(placed(features_at([2.0] * 3), None, plain).depth.depth / 2) == pytest.approx(-0.04 * plain, abs=2e-3)
    features, true = features_at([]), 1.8
    seen_as = PointOnLink(features, PIXEL, np.zeros(1), None, plain)._at(np.array([true * np.exp(0.037 * plain)]))
    for turned in np.linspace(-0.3, 0.3, 13):
        rotation, translation = features.chain.link_poses(np.array([[turned]]))
        place = features.pixels(seen_as @ rotation[0, 0].T + translation[0, 0])
        image = np.random.default_rng(0).integers(0, 255, (240, 320)).astype(np.uint8)
        features.keyframes.append(Keyframe(np.array([turned]), np.zeros(1, int), place, image))
    features.states[POINT], features.points[POINT] = FeatureState.KNOWN, seen_as[0]
    by_places = placed(features, None, plain)
    assert by_places.slip == pytest.approx(0.037 * plain)
    assert np.log(by_places.depth.depth / true) == pytest.approx(0.0, abs=2e-3)
    np.testing.assert_allclose(features.points[POINT], by_places._at(np.array([by_places.depth.depth]))[0])


@pytest.mark.parametrize(
    ("apart", "relief", "plain", "nearness", "left"),
    [
        (0.04, 0.0, 0.0, 0.03, [0.0064]), (-0.04, 0.0, 0.0, 0.03, [0.0064]), (0.0, 0.01, 0.0, 0.03, [0.0085]),
        (0.0, 0.0, 0.8, 0.03, [0.0064]), (0.04, 0.01, 0.5, 0.055, [0.0064, 0.0085, 0.004]),
        (0.0, 0.0, 0.0, 0.03, []), (0.04, 0.01, 0.5, 0.0551, None),
    ],
)  # fmt: skip
def test_what_features_and_surface_leave_is_by_the_image_and_the_surface_about_the_point(
    apart, relief, plain, nearness, left
):
    """Beside 0.7 of what they say of themselves; features too far away are no witness."""
    found, features = PointDepth(2.1, 0.01), PointDepth(2.0, nearness)
    witness = witnessed(found, features, PointDepth(2.0 * np.exp(apart), 0.02), relief, plain)
    expected = 0.01 if left is None else np.sqrt(0.007**2 + np.sum(np.square(left)))
    assert (witness.depth, witness.deviation) == (2.1, pytest.approx(expected))
    alone = [witnessed(found, *pair, relief, plain) for pair in ((features, None), (None, features))]
    assert alone == [found, found]


def test_the_relief_of_the_surface_is_what_it_was_where_the_point_was_defined():
    features = features_at([2.0, 2.0, 2.0])
    places = PIXEL + np.column_stack([16.0 + 9 * np.arange(3), np.zeros(3)])
    features.points[1:] = 2.0 * np.column_stack([(places - CENTER) / FOCAL, np.ones(3)])
    own = 0.7 / np.hypot(1 / 0.015, 1 / np.hypot(0.03, 0.0015 * 16))
    deviation = placed(features, (0, 2.0, None, 0.03), 0.5).depth.deviation
    apart = 0.5 * (0.04 - 0.005)  # as features slip more than the surface
    assert deviation == pytest.approx(np.linalg.norm([own, 0.85 * 0.03, 0.5 * 0.008, 0.16 * apart]), rel=1e-4)


def test_the_surface_follows_the_chain_s_unit_of_length():
    features = features_at([1.8, 2.0, 2.2])
    point = placed(features, (0, 2.0))
    before = point.depth.depth
    features.points[1:] *= 1.1
    point.place(np.arange(4))
    assert point.depth.depth == pytest.approx(1.1 * before, rel=0.003)
    features.states[2] = FeatureState.DROPPED  # what is left tells the unit
    features.points[2] *= 9
    point.place(np.arange(4))
    features.states[1:] = FeatureState.DROPPED
    point.place(np.arange(4))  # nothing does any more: as it was
    assert point.depth.depth == pytest.approx(2.0, rel=0.003)


def test_a_posture_is_planned_by_how_well_the_model_knows_each_joint():
    """Two joints do alike to the point; the one whose line the model knows badly is left where it is."""
    axis = np.array([0.0, 0.0, 1.0])
    chain = Chain(
        np.array([axis, axis]), np.array([[-0.6, 0.0, 0.0], [-0.6, 0.0, 0.0]]), np.zeros(2), np.array([-1, 0])
    )
    features = BodyFeatures(chain, FOCAL, CENTER, np.ones(2, bool))
    features.added(1)
    features.links[POINT] = 1
    features.keyframes = [Keyframe(np.zeros(2), np.zeros(0, int), np.zeros((0, 2)), np.zeros((240, 320), np.uint8))]
    limits = np.array([[-2.0, 2.0]] * 2)
    for bad in (0, 1):
        lines = np.zeros((2, 9))
        lines[:, 4 * bad + 2 : 4 * bad + 4] = 0.05 * np.eye(2)  # shifts of its line
        surface = SurfacePlace(1, 2.0, (lines, np.zeros(2)))
        point = PointOnLink(features, PIXEL, np.zeros(2), surface)
        point.place(np.zeros(1, int))
        target = point._seen_in(np.array([[0.2, 0.2]]))[0][0]
        posture = point.posture_for(target, np.zeros(2), limits, held=np.zeros(2, bool))
        assert posture is not None
        np.testing.assert_allclose(point._seen_in(posture[None])[0][0], target, atol=1.0)
        assert abs(posture[bad]) < 0.05
        assert posture[1 - bad] > 0.3


def test_a_way_is_planned_in_the_image_that_the_camera_has(monkeypatch):
    """Of 240 rows and 320 columns, about the place that is 159.5 px to the right and 119.5 px down."""
    point, asked = placed(features_at([]), (0, 1.7)), {}
    monkeypatch.setattr(point_on_link, "planned_posture", lambda *args, **options: asked.update(options))
    assert point.posture_for(PIXEL, np.zeros(1), np.array([[-1.0, 1.0]]), held=np.zeros(1, bool)) is None
    assert asked["size"] == (240, 320)
    np.testing.assert_array_equal(asked["home"], np.zeros(1))


@pytest.mark.parametrize("turned", [0.0, 0.4])
def test_what_features_were_off_where_the_point_was_defined_is_known_and_turns_with_the_link(turned):
    """The chain has all features 3 px left of and 1 px below where they were seen: so does it not have the point."""
    axis = np.array([0.0, 0.0, 1.0])
    chain = Chain(axis[None], np.array([[0.1, 0.2, 0.0]]), np.zeros(1), np.array([-1]))
    features = BodyFeatures(chain, FOCAL, CENTER, np.array([True]))
    numbers = features.added(7)
    places = PIXEL + np.array([[0, 0], [20, 5], [-9, 12], [4, -15], [11, 30], [-25, -8], [30, -30]])
    features.points[:] = 2.0 * features.rays(places)
    features.links[:], features.states[1:] = 0, FeatureState.KNOWN
    features.states[6] = FeatureState.YOUNG  # what is not known to be on the link does not count
    features.keyframes = [Keyframe(np.zeros(1), np.zeros(0, int), np.zeros((0, 2)), np.zeros((240, 320), np.uint8))]
    point = PointOnLink(features, PIXEL, np.zeros(1), SurfacePlace(0, 2.0))
    off = np.array([3.0, -1.0])
    begun = places + off
    begun[6] += 50
    point.place(numbers)
    np.testing.assert_array_equal(point.astray(np.array([turned])), 0.0)  # nothing is known of where they were seen
    point.begin(begun, np.tile(np.eye(2), (7, 1, 1)))
    point.place(numbers)
    turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    np.testing.assert_allclose(point.astray(np.array([turned])), turn @ off, atol=1e-6)
    features.states[3:] = FeatureState.DROPPED
    point.place(numbers)  # two are too few
    np.testing.assert_array_equal(point.astray(np.array([turned])), 0.0)


def test_features_about_the_point_tell_most_of_what_it_is_off():
    features = features_at([2.0] * 30)
    numbers = np.arange(31)
    places = features.project(numbers, np.zeros(1))
    off = np.zeros((31, 2))
    off[1:4, 0] = 1.0
    off[20:, 0] = -1.0  # more of them, but far
    point = PointOnLink(features, PIXEL, np.zeros(1), SurfacePlace(0, 2.0))
    point.begin(places + off, np.tile(np.eye(2), (31, 1, 1)))
    point.place(numbers)
    assert point.astray(np.zeros(1))[0] > 0.25


def test_the_chain_s_place_is_known_half_as_well_as_its_lines_and_to_half_a_pixel():
    """By the chain as it is now: lines, focal length and the point's depth change as features come."""
    random = np.random.default_rng(2)
    features = features_at([2.0] * 4)
    surface = SurfacePlace(0, 2.0, (0.01 * random.normal(size=(3, 5)), 0.02 * random.normal(size=3)))
    point = PointOnLink(features, PIXEL, np.zeros(1), surface)
    point.place(np.arange(5))
    for q in (np.array([0.4]), np.array([-0.2])):
        for _ in range(2):
            by_lines = PlaceErrors(features, PIXEL, np.zeros(1), point.depth, surface, 0)(q[None])[0, :-1]
            assert np.trace(by_lines.T @ by_lines) > 0.1
            np.testing.assert_allclose(point.covariance(q), 4 * by_lines.T @ by_lines + 0.25 * np.eye(2))
            features.chain = features.chain.moved(0.02 * random.normal(size=(1, 4)))
            features.focal *= 1.01
        before = point.covariance(q)
        point.depth = PointDepth(1.3 * point.depth.depth, point.depth.deviation)
        assert not np.allclose(point.covariance(q), before)
        by_lines = PlaceErrors(features, PIXEL, np.zeros(1), point.depth, surface, 0)(q[None])[0, :-1]
        np.testing.assert_allclose(point.covariance(q), 4 * by_lines.T @ by_lines + 0.25 * np.eye(2))
    np.testing.assert_allclose(point.covariance(np.zeros(1)), 0.25 * np.eye(2), atol=1e-9)  # where it was defined


@pytest.mark.parametrize("surface", [None, (0, 1.7), (1, 1.7)])
def test_a_model_that_knows_no_errors_knows_the_chain_s_place_less(surface):
    point = PointOnLink(features_at([]), PIXEL, np.zeros(1), surface and SurfacePlace(*surface))
    for _ in range(2):
        np.testing.assert_allclose(point.covariance(np.array([0.3])), 1.44 * np.eye(2))
        point.place(np.arange(1))


def test_unless_said_otherwise_an_image_is_textured_and_a_surface_faces_the_camera():
    assert PointOnLink(features_at([]), PIXEL, np.zeros(1)).slip == 0.0
    np.testing.assert_array_equal(PointDepth(1.0, 0.1).slope, 0.0)


def test_three_features_about_a_point_tell_what_it_was_off():
    features = features_at([2.0, 2.0, 2.0])
    point = PointOnLink(features, PIXEL, np.zeros(1), SurfacePlace(0, 2.0))
    numbers, off = np.arange(4), np.array([1.5, -0.5])
    point.begin(features.project(numbers, np.zeros(1)) + off, np.tile(np.eye(2), (4, 1, 1)))
    point.place(numbers)
    np.testing.assert_allclose(point.astray(np.zeros(1)), off, atol=1e-6)
    features.states[3] = FeatureState.DROPPED  # two do not
    point.place(numbers)
    np.testing.assert_array_equal(point.astray(np.zeros(1)), 0.0)


def test_the_direction_that_a_link_is_seen_from_turns_with_it():
    """In the link's own frame, from the camera to the point, of length 1; the chain's line is 2 before the camera."""
    features = features_at([])
    point = placed(features, (0, 1.7))
    for turned in (0.0, 0.5):
        places, views = point._seen_in(np.array([[turned]]))
        turn = np.array([[np.cos(turned), 0, np.sin(turned)], [0, 1, 0], [-np.sin(turned), 0, np.cos(turned)]])
        middle = np.array([0.0, 0.0, 2.0])
        there = turn @ (features.points[POINT] - middle) + middle
        np.testing.assert_allclose(places[0], FOCAL * there[:2] / there[2] + CENTER)
        np.testing.assert_allclose(views[0], turn.T @ there / np.linalg.norm(there))
