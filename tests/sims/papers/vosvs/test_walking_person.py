"""A person's walk, by hand: how it speeds up, turns, slows down, and what is shown of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.vosvs.walking_person import Stroll, WalkingPerson


class Shown:
    def show(self, pose):
        self.pose = pose


def test_a_walk_arrives_and_stops():
    walker = WalkingPerson(Shown(), (0.0, 0.0), np.pi)
    walker.goal, walker.speed = np.array([1.5, 1.0]), 0.8
    places = [walker.place]
    for _ in range(200):
        walker()
        places.append(walker.place)
    assert walker.there
    assert np.hypot(*(walker.place - [1.5, 1.0])) < 0.15
    steps = np.hypot(*np.diff(np.array(places), axis=0).T)
    assert steps.max() <= 0.8 / 30 + 1e-9
    assert steps[-20:].max() == 0.0
    assert walker.traveled == pytest.approx(steps.sum())
    assert walker.person.pose.stride == 0.0
    while not walker.face(np.array([1.5, -5.0])):
        pass
    walker.show()
    assert walker.heading == pytest.approx(-np.pi / 2, abs=0.1)


def test_a_hand_stays_before_the_walker():
    walker = WalkingPerson(Shown(), (2.0, 1.0), np.pi / 2)
    walker.hand = np.array([0.4, -0.2, 1.1])
    walker.show()
    np.testing.assert_allclose(walker.person.pose.right_hand, (2.2, 1.4, 1.1))


def test_a_stroll_goes_on():
    walker = WalkingPerson(Shown(), (0.0, 0.0), 0.0)
    goals = [np.array([0.5, 0.0]), np.array([0.5, 0.6]), np.array([0.0, 0.0])]
    drawn = []

    def draw(rng):
        drawn.append(goals[len(drawn) % 3])
        return drawn[-1]

    stroll = Stroll(walker, draw, np.random.default_rng(1), (0.4, 0.9))
    for _ in range(400):
        stroll()
        assert 0.4 <= walker.speed <= 0.9
    assert len(drawn) >= 3
    assert walker.traveled > 1.0


def at(pace=0.0, heading=0.0, place=(0.0, 0.0), goal=None, speed=0.7):
    """A walker of that pace [m/s]."""
    walker = WalkingPerson(Shown(), place, heading)
    walker._pace, walker.speed = pace, speed
    walker.goal = None if goal is None else np.array(goal)
    return walker


@pytest.mark.parametrize(("pace", "stride"), [(0.0, 0.0), (0.25, 0.155), (0.5, 0.31), (0.7, 0.31)])
def test_steps_are_short_below_half_a_meter_a_second(pace, stride):
    walker = at(pace)
    walker.show()
    assert walker.person.pose.stride == pytest.approx(stride)


@pytest.mark.parametrize(
    ("pace", "goal", "after"),
    [
        (0.0, (9.0, 0.0), 0.04),  # 1.2 m/s^2 for a thirtieth of a second
        (0.68, (9.0, 0.0), 0.7),
        (0.7, None, 0.62),  # it stops twice as fast
        (0.05, None, 0.0),
        (0.6, (0.15, 0.0), 0.6),  # as fast as may be 15 cm before the goal
        (0.64, (0.15, 0.0), 0.6),
        (0.7, (-9.0, 0.0), 0.62),  # the goal is behind
        (0.7, (9.0 * np.cos(1.0), 9.0 * np.sin(1.0)), 0.62),  # it has not turned yet
        (0.24, (9.0 * np.cos(1.0), 9.0 * np.sin(1.0)), 0.7 * np.cos(1.0 - 2.0 / 30) ** 2),
    ],
)
def test_the_pace_of_a_frame(pace, goal, after):
    walker = at(pace, goal=goal)
    walker()
    assert walker._pace == pytest.approx(after)
    assert walker.traveled == pytest.approx(after / 30)


@pytest.mark.parametrize(("distance", "there"), [(0.079, True), (0.081, False)])
def test_a_goal_is_there_from_eight_centimeters(distance, there):
    walker = at(goal=(0.0, distance))
    walker()
    assert walker.there == there


def test_two_steps_are_a_cycle():
    walker = at(0.62, goal=(9.0, 0.0), speed=0.62)
    for _ in range(60):
        walker()
    np.testing.assert_allclose(walker.place, [1.24, 0.0], atol=1e-9)
    assert walker.person.pose.phase == pytest.approx(2 * np.pi)


@pytest.mark.parametrize(
    ("heading", "angle", "after", "done"),
    [
        (0.0, 0.066, 0.066, True),  # 2 rad/s are 0.067 rad a frame
        (0.0, -0.066, -0.066, True),
        (0.0, 0.067, 2 / 30, False),
        (0.0, -1.0, -2 / 30, False),
        (3.0, -3.0, 3.0 + 2 / 30, False),  # the shorter way round
        (-3.0, 3.0, -3.0 - 2 / 30, False),
        (7.0, 7.0 - 2 * np.pi, 7.0, True),
    ],
)
def test_a_turn_takes_its_time_and_the_shorter_way(heading, angle, after, done):
    walker = at(heading=heading, place=(2.0, 1.0))
    assert walker.face(np.array([2.0 + np.cos(angle), 1.0 + np.sin(angle), 9.0])) == done
    assert walker.heading == pytest.approx(after)


def test_a_hand_is_turned_with_the_walker():
    walker = at(heading=np.arctan2(0.6, 0.8), place=(2.0, 1.0))
    walker.hand = np.array([1.0, 0.5, 1.1])
    walker.show()
    np.testing.assert_allclose(walker.person.pose.right_hand, (2.0 + 0.8 - 0.3, 1.0 + 0.6 + 0.4, 1.1))


def test_a_stop_is_as_long_as_drawn():
    """The place that is drawn is where the walker stands: it is there at once, and stops for three frames."""
    drawn, told = [], []

    def draw(rng):
        drawn.append(len(told))
        return np.array([0.0, 0.0])

    rng = SimpleNamespace(uniform=lambda low, high: low, integers=lambda low, high: 3 if (low, high) == (0, 30) else 9)
    walker = at()
    stroll = Stroll(walker, draw, rng)
    for frame in range(9):
        told.append(frame)
        stroll()
    assert drawn == [1, 5, 9]
    assert walker.speed == 0.4


def test_a_walker_is_not_sent_elsewhere_on_the_way():
    rng = SimpleNamespace(uniform=lambda low, high: high, integers=lambda *_: 0)
    walker, places = at(), [np.array([1.0, 0.0])]
    stroll = Stroll(walker, lambda rng: places.pop(), rng)
    for _ in range(20):
        stroll()  # no other place could be drawn
    assert not walker.there
    assert walker.speed == 0.9
