"""Planned postures against thousands at random: near, in the limits, well known, and seen from where it was seen."""

import numpy as np
import pytest

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo.planned_posture import AIM, LOOK, MARGIN, RANGE, TRAVEL, TURNED, planned_posture

FOCAL, CENTER = 300.0, np.array([160.0, 120.0])
LIMITS = np.array([[-1.2, 1.2], [-1.0, 1.0], [-0.8, 1.4], [-1.5, 1.5]])
HOME = np.zeros(4)
FREE = np.zeros(4, bool)
POINT = np.array([0.1, -0.05, 2.0])
AXES = np.array([[0.0, 1.0, 0.1], [1.0, 0.1, 0.0], [0.1, 0.0, 1.0], [0.7, 0.7, 0.0]])
CHAIN = Chain(
    AXES / np.linalg.norm(AXES, axis=1, keepdims=True),
    np.array([[0.0, 0.5, 2.4], [-0.2, 0.3, 2.3], [0.0, 0.2, 2.2], [0.1, 0.1, 2.2]]),
    HOME,
    np.array([-1, 0, 1, 2]),
)


def seen(postures):
    rotation, translation = (value[:, 3] for value in CHAIN.link_poses(np.asarray(postures, float)))
    there = rotation @ POINT + translation
    views = np.einsum("tji,tj->ti", rotation, there)
    places = CENTER + FOCAL * there[:, :2] / there[:, 2:]
    return places, views / np.linalg.norm(views, axis=1, keepdims=True), np.zeros((len(places), 0))


VIEW = seen(HOME[None])[1][0]


def drawn(count=20000):
    return np.random.default_rng(1).uniform(LIMITS[:, 0], LIMITS[:, 1], (count, 4))


def cost(places, views, target, postures, now=HOME):
    """Way to the target, change of the view, way of the joints and their turn since the home posture, as weighed."""
    parts = AIM * (places - target), LOOK * (views - VIEW), TRAVEL * (postures - now), TURNED * (postures - HOME)
    return sum(np.sum(part**2, axis=-1) for part in parts)


@pytest.mark.parametrize("number", range(6))
def test_a_target_that_can_be_reached_is_reached_from_where_it_was_seen(number):
    target = seen(drawn()[number : number + 1])[0][0]
    posture = planned_posture(seen, VIEW, target, HOME, LIMITS, fixed=FREE)
    (place,), (view,), _ = seen(posture[None])
    assert np.linalg.norm(place - target) < 1.0
    assert (posture >= LIMITS[:, 0] + MARGIN - 1e-9).all()
    assert (posture <= LIMITS[:, 1] - MARGIN + 1e-9).all()
    places, views, _ = seen(drawn())
    assert cost(place, view, target, posture) < cost(places, views, target, drawn()).min() + 0.1


@pytest.mark.parametrize("number", range(3))
def test_a_way_from_elsewhere_leads_back_toward_where_the_point_was_defined(number):
    now, target = np.array([0.9, -0.8, 1.2, 1.3]), seen(drawn()[number : number + 1])[0][0]
    posture = planned_posture(seen, VIEW, target, now, LIMITS, fixed=FREE, home=HOME)
    (place,), (view,), _ = seen(posture[None])
    places, views, _ = seen(drawn())
    assert cost(place, view, target, posture, now) < cost(places, views, target, drawn(), now).min() + 0.1
    away = planned_posture(seen, VIEW, target, now, LIMITS, fixed=FREE)
    assert np.linalg.norm(posture) < np.linalg.norm(away)


@pytest.mark.parametrize("joint", range(4))
def test_a_joint_that_is_badly_known_turns_less(joint):
    target = seen(drawn()[7:8])[0][0]
    usual = planned_posture(seen, VIEW, target, HOME, LIMITS, fixed=FREE)

    def seen_so(postures):
        places, views, _ = seen(postures)
        return places, views, 15.0 * postures[:, joint : joint + 1]

    careful = planned_posture(seen_so, VIEW, target, HOME, LIMITS, fixed=FREE)
    assert abs(careful[joint]) <= abs(usual[joint]) + 0.02
    (place,), (view,), (error,) = seen_so(careful[None])
    places, views, errors = seen_so(drawn())
    assert np.linalg.norm(place - target) < 1.0
    all_drawn = cost(places, views, target, drawn()) + np.sum(errors**2, axis=1)
    assert cost(place, view, target, careful) + np.sum(error**2) < all_drawn.min() + 0.1


def test_joints_that_are_held_stay():
    target = seen(np.array([[0.3, -0.2, 0.2, 0.4]]))[0][0]
    now = np.array([0.05, -0.1, 0.2, -0.3])
    fixed = np.array([False, True, False, True])
    posture = planned_posture(seen, VIEW, target, now, LIMITS, fixed=fixed)
    np.testing.assert_array_equal(posture[fixed], now[fixed])
    assert np.linalg.norm(seen(posture[None])[0][0] - target) < 1.5
    assert planned_posture(seen, VIEW, target, now, LIMITS, fixed=~FREE) is None


def test_nothing_is_planned_to_where_the_point_cannot_get():
    assert planned_posture(seen, VIEW, np.array([5000.0, 120.0]), HOME, LIMITS, fixed=FREE) is None


def test_a_plan_is_bettered_from_a_posture_that_is_known():
    target = seen(np.array([[0.3, -0.2, 0.2, 0.4]]))[0][0]
    whole = planned_posture(seen, VIEW, target, HOME, LIMITS, fixed=FREE)
    again = planned_posture(seen, VIEW, target, HOME, LIMITS, fixed=FREE, start=whole + 0.02)
    np.testing.assert_allclose(again, whole, atol=0.02)


def test_joints_without_limits_go_as_far_as_the_range():
    target = seen(np.array([[0.3, -0.2, 0.2, 0.4]]))[0][0]
    endless = np.array([[-np.inf, np.inf]] * 4)
    posture = planned_posture(seen, VIEW, target, HOME, endless, fixed=FREE)
    assert (np.abs(posture) <= RANGE).all()
    assert np.linalg.norm(seen(posture[None])[0][0] - target) < 1.0


def around(postures):
    """A point that the first joint leads in a circle through the image, in the middle half of it and out of it."""
    angle = np.asarray(postures)[:, 0]
    places = np.column_stack([160 + 200 * np.sin(angle), 120 - 100 * np.cos(angle)])
    return places, np.tile([0.0, 0.0, 1.0], (len(angle), 1)), np.zeros((len(angle), 0))


@pytest.mark.parametrize(("size", "right"), [(None, True), ((240, 320), False)])
def test_a_way_in_the_image_is_taken_though_it_is_farther(size, right):
    """From (160, 220) to (160, 20) it is 0.1 rad less by the right, where the circle goes 40 px out of the image."""

    def seen_so(postures):
        places, *others = around(postures)
        places[:, 0] = np.where(places[:, 0] < 160, 160 + 0.5 * (places[:, 0] - 160), places[:, 0])
        return places, *others

    now, limits = np.array([np.pi - 0.05]), np.array([[-0.5, 2 * np.pi + 0.5]])
    target = np.array([160.0, 20.0])
    posture = planned_posture(seen_so, np.array([0.0, 0.0, 1.0]), target, now, limits, fixed=FREE[:1], size=size)
    assert posture[0] == pytest.approx(0.0 if right else 2 * np.pi, abs=0.02)


@pytest.mark.parametrize(("size", "below"), [(None, True), ((240, 320), False), ((320, 240), True)])
def test_a_way_leaves_the_image_below_its_height(size, below):
    """From (220, 120) to (20, 120) it is 0.1 rad less by the lower one, which goes down to row 280."""

    def seen_so(postures):
        angle = np.asarray(postures)[:, 0]
        across, down = 120 + 100 * np.cos(angle), 160 * np.sin(angle)
        places = np.column_stack([across, 120 + np.where(down < 0, 0.5 * down, down)])
        return places, np.tile([0.0, 0.0, 1.0], (len(angle), 1)), np.zeros((len(angle), 0))

    now, limits = np.array([0.05]), np.array([[-np.pi - 0.5, np.pi + 0.5]])
    target, view = np.array([20.0, 120.0]), np.array([0.0, 0.0, 1.0])
    posture = planned_posture(seen_so, view, target, now, limits, fixed=FREE[:1], size=size)
    assert posture[0] == pytest.approx(np.pi if below else -np.pi, abs=0.02)


def test_a_joint_with_no_room_between_its_limits_stays():
    limits = LIMITS.copy()
    limits[2] = 0.03, 0.03
    now = np.array([0.0, 0.0, 0.03, 0.0])
    target = seen(np.array([[0.3, -0.2, 0.03, 0.1]]))[0][0]
    posture = planned_posture(seen, VIEW, target, now, limits, fixed=FREE)
    assert posture[2] == 0.03
    assert np.linalg.norm(seen(posture[None])[0][0] - target) < 1.0


@pytest.mark.parametrize("room", [0.02, 0.05, 0.3, 3.0])
def test_the_margin_is_a_share_of_little_room(room):
    """As of a slide of some centimeters: it goes to within a twentieth of its limits, and no nearer."""
    limits = np.array([[0.0, room]])

    def seen_so(postures):
        places = np.column_stack([100.0 / room * postures[:, 0], np.zeros(len(postures))])
        return places, np.tile(VIEW, (len(postures), 1)), np.zeros((len(postures), 1))

    margin = min(MARGIN, 0.05 * room)
    for at, reached in ((room - 1.01 * margin, True), (0.5 * room, True), (room + 0.04 * room, False)):
        target = np.array([100.0 / room * at, 0.0])
        posture = planned_posture(seen_so, VIEW, target, np.array([0.3 * room]), limits, fixed=np.zeros(1, bool))
        assert (posture is not None) == reached
        assert posture is None or margin * 0.999 <= posture[0] <= room - margin * 0.999
