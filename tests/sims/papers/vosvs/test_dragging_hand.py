"""A chain that is dragged about keeps moving, stays together and stays in the room."""

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
