"""A chain that is dragged about keeps moving, stays together and stays in the room."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs.dragging_hand import ROOM, DraggingHand

NAME = "Plastic Chain"


@pytest.fixture(scope="module")
def world():
    return MobileWorld([NAME], seed=3, device="cpu")


@pytest.mark.slow
def test_chain_is_dragged_about(world):
    rng = np.random.default_rng(5)
    world.lay_chain(NAME, (1.5, 1.5, 0.0), rng)
    middle = world.object_position(NAME)[:2].copy()
    hand = DraggingHand(world, NAME, 0.25, rng)
    world.before_frame = hand
    places = []
    for _ in range(30):
        world.wait(10)
        places.append(world.object_position(NAME)[:2].copy())
    world.before_frame = None
    hand.let_go()
    steps = np.hypot(*np.diff(np.array(places), axis=0).T)
    assert steps.max() < 0.3  # m in a third of a second: nothing flies
    assert (steps > 0.01).mean() > 0.8
    assert np.hypot(*(np.array(places) - middle).T).max() < ROOM + 0.7


class Rope:
    """A chain whose end is at (1, 1) and goes where it is pulled."""

    frames = 40

    def object_position(self, name):
        return np.array([1.0, 1.0, 0.0])

    def pull_chain(self, name, place):
        self.pulled = place
        return np.array([1.0, 1.0, 0.3])


@pytest.fixture(params=[1, -1])
def hand(request):
    """One that heads along x; its way winds no more, and it turns as far to either side as it may."""

    def uniform(low, high):
        assert low == -high
        return 0.0 if high > 3 else request.param * high

    one = DraggingHand(Rope(), NAME, 0.25, SimpleNamespace(uniform=uniform, standard_normal=lambda: 0.0))
    one.side = request.param
    return one


@pytest.mark.parametrize(
    ("place", "heading", "back"),
    [
        ((1.89, 1.0), 0.0, None),  # in the room
        ((1.91, 1.0), 0.0, np.pi),
        ((1.91, 1.0), 3.0, None),  # it is on its way back
        ((1.91, 1.0), -2.0, None),
        ((1.0, 0.05), -1.0, np.pi / 2),
        ((0.3, 1.7), 2.0, np.arctan2(-0.7, 0.7)),  # 0.99 m away in both
    ],
)
def test_a_hand_that_leaves_the_room_turns_back(hand, place, heading, back):
    """But for 0.8 rad to either side."""
    hand._place[:2], hand._heading = place, heading
    hand()
    after = heading if back is None else back + 0.8 * hand.side
    assert np.cos(hand._heading - after) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("frame", "before", "after"),
    [(0, 0.25, 0.25 + 4 / 30), (5, 0.75, 0.8), (6, 0.25, 0.25), (6, 0.8, 0.8 - 4 / 30), (120, 0.25, 0.25 + 4 / 30)],
)
def test_a_jerk_takes_the_first_twentieth_of_four_seconds(hand, frame, before, after):
    hand._world.frames = 40 + frame
    hand._velocity = np.array([before, 0.0])
    hand()
    np.testing.assert_allclose(hand._velocity, [after, 0.0])
    np.testing.assert_allclose(hand._world.pulled, [1.0 + after / 30, 1.0, 0.012])
