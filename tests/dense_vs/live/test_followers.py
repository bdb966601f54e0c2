"""Points that go by the body: late answers correct them, old ones leave them uncertain, and reached is certain."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.live.followers import FRESH, STALE, BodyFollower
from dense_vs.live.points import SETTLE_FRAMES, LivePoint, LivePoints, PointState
from dense_vs.live.report import Told
from dense_vs.live.seen_point import SeenPoint
from dense_vs.point_servo.reach import Arrival


def seen(x, y, certain=True, lost=False, uncertainty=0.4):
    return SeenPoint(np.array([x, y], float), certain, lost, uncertainty)


@pytest.fixture
def body():
    return SimpleNamespace(alive=True)


def follower(body, **answer):
    return BodyFollower(body, np.array([50.0, 40.0]), 10, seen(50, 40, **answer))


def carry(one, frames, motion=(2.0, 0.0), first=11):
    for number in range(first, first + frames):
        one.carry(number, np.array(motion))


def test_a_late_answer_corrects_what_came_after_it(body):
    one = follower(body)
    carry(one, 5)
    np.testing.assert_allclose(one.place, [60, 40])
    one.take(12, seen(53, 41))  # it was taken to be at 54, 40
    np.testing.assert_allclose(one.place, [59, 41])
    one.take(14, seen(57.5, 41))  # 57, 41 by now
    np.testing.assert_allclose(one.place, [59.5, 41])
    one.take(14, seen(58.5, 42))  # of the same frame again
    np.testing.assert_allclose(one.place, [60.5, 42])
    one.take(14, seen(np.nan, 45))
    np.testing.assert_allclose(one.place, [60.5, 42])


def test_an_answer_about_a_frame_that_is_no_longer_kept_moves_nothing(body):
    one = follower(body)
    carry(one, 5)
    one.take(9, seen(0, 0))
    np.testing.assert_allclose(one.place, [60, 40])
    one.take(13, seen(np.nan, np.inf))
    np.testing.assert_allclose(one.place, [60, 40])


def test_certain_is_what_the_body_says_and_not_for_long(body):
    one = follower(body)
    assert one.certain
    assert one.fresh
    carry(one, FRESH + 1)
    assert one.certain
    assert not one.fresh
    carry(one, STALE, first=11 + FRESH + 1)
    assert not one.certain
    assert "late" in one.why
    one.take(11 + FRESH + STALE, seen(50, 40, certain=False, uncertainty=1.3))
    assert one.fresh
    assert not one.certain
    assert "2.6 px" in one.why


def test_a_process_that_ended_leaves_the_point_lost(body):
    one = follower(body)
    body.alive = False
    assert one.lost
    assert not one.certain
    assert "process ended" in one.why


def point(body, **answer):
    one = LivePoint(1, follower(body, **answer), target=np.array([50.5, 40.0]))
    for _ in range(SETTLE_FRAMES):
        one.arrival.observe(one.error)
    return one


@pytest.mark.parametrize(
    ("answer", "state"),
    [
        ({}, PointState.REACHED),
        ({"certain": False, "uncertainty": 1.3}, PointState.UNCERTAIN),
        ({"certain": False, "lost": True}, PointState.LOST),
    ],
)
def test_reached_is_settled_and_certain(body, answer, state):
    one = point(body, **answer)
    assert one.arrival.settled
    assert one.state is state
    assert bool(one.why) is (state is not PointState.REACHED)


def test_uncertain_comes_and_goes_without_a_line_in_the_log(body):
    points, told = LivePoints(48, 64), Told()
    one = point(body)
    points._points[1] = one
    assert [line for line, _ in told.changes(points)] == ["point 1: reached"]
    one.follower.take(10, seen(50, 40, certain=False))
    assert one.state is PointState.UNCERTAIN
    assert list(told.changes(points)) == []
    one.follower.take(10, seen(50, 40))
    assert list(told.changes(points)) == []
    one.follower.take(10, seen(50, 40, certain=False, lost=True))
    assert [level for _, level in told.changes(points)] == ["warning"]


def test_arrival_counts_frames_in_a_row():
    arrival = Arrival(1.0, 3)
    for distance, blind, settled in (
        (0.5, False, False),
        (0.5, False, False),
        (1.1, False, False),
        (1.0, False, False),
        (0.2, True, False),  # nothing was seen
        (0.2, False, False),
        (0.2, False, False),
        (0.2, False, True),
        (1.1, False, False),
    ):
        arrival.observe(distance, blind=blind)
        assert arrival.settled is settled


def test_what_has_arrived_stays_so_until_it_leaves():
    arrival = Arrival(1.0, 2, leave=2.0)
    for distance, settled in ((1.5, False), (0.5, False), (0.5, True), (1.9, True), (2.1, False), (1.9, False)):
        arrival.observe(distance)
        assert arrival.settled is settled
