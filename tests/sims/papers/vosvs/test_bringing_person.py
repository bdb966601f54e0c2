"""How a thing is brought, frame by frame, to a robot on the left: a person comes from the right, stoops and leaves."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.mobile_manipulator.person import HIP
from dense_vs.sims.papers.vosvs.bringing_person import BringingPerson

STOOPED, CARRIED = (0.42, 1.1), (0.34, -0.16, 1.02)


class Hand:
    """A person who is shown; counts what was shown until the hand opened."""

    def __init__(self):
        self.held, self.shown, self.opened = [], 0, None

    def show(self, pose):
        self.shown += 1

    def hold(self, name):
        self.held.append(name)

    def let_go(self):
        assert self.opened is None
        self.opened = self.shown


def brought(start=(2.52, 0.0), goal=(0.0, 0.0)):
    placed = []
    world = SimpleNamespace(
        objects={"Box": SimpleNamespace(height=0.2)},
        place=lambda name, place, turn, settle_frames: placed.append((name, *place, turn, settle_frames)),
    )
    person = Hand()
    return BringingPerson(world, person, "Box", start, np.array(goal), (-1.0, 0.0)), person, placed


def test_the_thing_begins_in_the_hand():
    walk, person, placed = brought()
    assert walk.walker.heading == pytest.approx(np.pi)
    np.testing.assert_allclose(walk.walker.place, [2.52, 0.0])
    assert walk.walker.hand.tolist() == list(CARRIED)
    assert person.held == ["Box"]
    ((name, *place, turn, settle),) = placed
    # 34 cm before the person and 5 cm more, 16 cm to the right, under the hand by half its height.
    np.testing.assert_allclose(place, [2.52 - 0.39, 0.16, 0.92])
    assert (name, settle) == ("Box", 0)
    assert turn == pytest.approx(1.5 * np.pi)
    aside, *_ = brought(start=(0.52, -2.0))
    assert aside.walker.heading == pytest.approx(np.pi / 2)  # toward where it stands to put the thing down


@pytest.fixture(scope="module")
def frames():
    """Hips, lean, hand, place and heading after each frame, and the frame in which the hand opens."""
    walk, person, _ = brought()
    states, opened = [], None
    while not walk.done:
        walk()
        one = walk.walker
        states.append((one.hips, one.lean, one.hand, one.place, one.heading))
        if person.opened is not None and opened is None:
            opened = len(states) - 1
        assert len(states) < 1000
    count = len(states)
    walk()  # nothing more
    assert len(states) == count
    assert walk.done is True
    return states, opened


def posture(state):
    return [state[0], state[1], *state[2]]


def test_the_thing_is_put_down_before_the_robot(frames):
    states, opened = frames
    down = [*STOOPED, 0.47, 0.0, 0.104]  # its lower side 4 mm over the floor, 52 cm before the hips
    np.testing.assert_allclose(posture(states[opened - 1]), down)
    np.testing.assert_allclose(states[opened][3], [0.52, 0.0], atol=0.081)
    assert np.cos(states[opened][4]) == pytest.approx(-1.0, abs=1e-3)  # it looks at the robot
    begin = np.array([HIP, 0.0, *CARRIED])
    np.testing.assert_allclose(posture(states[opened - 43]), begin)
    np.testing.assert_allclose(posture(states[opened - 22]), (begin + down) / 2)  # half the way in half of 1.4 s
    quarter = 0.5 - 0.5 * np.cos(np.pi / 6)
    np.testing.assert_allclose(posture(states[opened - 36]), begin + quarter * (down - begin))  # 7 frames of 42
    for state in states[opened : opened + 10]:
        np.testing.assert_allclose(posture(state), down)


def test_the_hand_goes_back_before_it_goes_up(frames):
    states, opened = frames
    back = [*STOOPED, 0.32, -0.05, 0.16]
    np.testing.assert_allclose(posture(states[opened + 21]), back)  # 12 frames after the pause of 10
    up = [HIP, 0.0, *CARRIED]
    np.testing.assert_allclose(posture(states[opened + 21 + 21]), (np.array(back) + up) / 2)
    np.testing.assert_allclose(posture(states[opened + 21 + 42]), up)
    assert states[opened + 21 + 43][2] is None


def test_the_person_steps_back(frames):
    states, opened = frames
    np.testing.assert_allclose(states[-1][3], [1.82, 0.0], atol=0.081)  # 1.3 m behind where it stood
    assert all(state[2] is None for state in states[opened + 64 :])
    np.testing.assert_allclose(states[-1][:2], [HIP, 0.0])


def test_a_person_who_comes_from_the_robot_turns_round():
    walk, person, _ = brought(start=(-0.5, 0.0))
    while person.opened is None:
        walk()
    assert np.cos(walk.walker.heading) == pytest.approx(-1.0, abs=0.01)
