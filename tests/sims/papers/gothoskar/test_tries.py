"""One try of a grasp or an insertion on a cell that says how it ended: success, failure, and what was not seen."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims.papers.gothoskar import guided_motion
from dense_vs.sims.papers.gothoskar.grasp import grasp
from dense_vs.sims.papers.gothoskar.insertion import insert

STANDS = np.array([0.5, 0.03, 0.4])  # m


class Cell:
    """Counts what it is told and ends as asked."""

    def __init__(self, raised, in_hand, depth):
        self._places = iter([STANDS, STANDS + raised])
        self._in_hand, self._depth = np.array(in_hand), depth
        self.closed = False
        self.chain = SimpleNamespace(home=np.zeros(6))

    def __getattr__(self, _):
        return lambda *_, **__: None

    def true_part_position(self):
        return next(self._places)

    def true_part_in_hand(self):
        return self._in_hand

    def true_insertion_depth(self):
        return self._depth

    def encoders(self):
        return np.zeros(6)

    def close_gripper(self):
        self.closed = True


@pytest.fixture
def guide(monkeypatch):
    """A guide whose motions are done at once."""

    def make(raised=(0, 0, 0.1), in_hand=(0, 0, 0), depth=0.04, seen=True):
        def sight(*_):
            if not seen:
                raise DenseVSError("no marker is seen")
            return np.zeros((2, 4, 2))

        for name, value in (
            ("average_sight", sight),
            ("approach", lambda *_, **__: np.zeros(6)),
            ("joints_for", lambda *_, **__: np.zeros(6)),
            ("stand_off", lambda hand, *_: hand),
            ("learn_structure", lambda *_, **__: np.arange(24.0).reshape(8, 3)),
            ("rigid_motion", lambda *_: (np.eye(3), np.zeros(3))),
        ):
            monkeypatch.setattr(guided_motion, name, value)
        model = SimpleNamespace(parameters=SimpleNamespace(features=np.zeros((4, 3))))
        return SimpleNamespace(cell=Cell(raised, in_hand, depth), model=model, joints_now=lambda: np.zeros(6))

    return make


@pytest.mark.parametrize(
    ("raised", "in_hand", "success"),
    [((0, 0, 0.1), (0, 0, 0), True), ((0, 0, 0.0), (0, 0, 0), False), ((0, 0, 0.1), (0.3, 0, 0), False)],
)
def test_a_grasp_is_what_the_block_says(guide, raised, in_hand, success):
    one = guide(raised, in_hand)
    assert grasp(one, np.zeros((4, 3)), np.random.default_rng(0)) is success
    assert one.cell.closed


def test_a_block_that_is_not_seen_is_not_grasped(guide):
    one = guide(seen=False)
    assert grasp(one, np.zeros((4, 3)), np.random.default_rng(0)) is False
    assert not one.cell.closed


@pytest.mark.parametrize("depth", [0.0, 0.0349, 0.04])
def test_an_insertion_is_as_deep_as_the_cell_says(guide, depth):
    part = np.arange(24.0).reshape(8, 3)
    assert insert(guide(depth=depth), part, part, np.random.default_rng(0)) == depth


def test_a_fixture_that_is_not_seen_has_nothing_in_it(guide):
    part = np.arange(24.0).reshape(8, 3)
    assert insert(guide(depth=0.04, seen=False), part, part, np.random.default_rng(0)) == 0.0


def test_a_block_is_put_anywhere_on_a_part_of_the_table(guide):
    rng, places, turns = np.random.default_rng(2), [], []
    for _ in range(60):
        one = guide()
        one.cell.place_part = lambda place, turn: (places.append(place), turns.append(turn))
        grasp(one, np.zeros((4, 3)), rng)
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    np.testing.assert_allclose(low, [0.43, -0.07], atol=0.02)
    np.testing.assert_allclose(high, [0.57, 0.13], atol=0.02)
    assert (low >= [0.43, -0.07]).all()
    assert (high <= [0.57, 0.13]).all()
    np.testing.assert_allclose([min(turns), max(turns)], [-0.5, 0.5], atol=0.06)


def test_the_hand_comes_nearer_from_above_and_rises_to_where_it_stood(guide, monkeypatch):
    one, sent, goals = guide(), [], []
    one.cell.command = sent.append
    monkeypatch.setattr(guided_motion, "stand_off", lambda hand, structure, factor: factor)
    monkeypatch.setattr(guided_motion, "joints_for", lambda guide, stand, pixels, now: np.full(6, stand))

    def approach(guide, goal, attempts, now):
        goals.append((goal[0], attempts))
        return goal + 0.01

    monkeypatch.setattr(guided_motion, "approach", approach)
    assert grasp(one, np.zeros((4, 3)), np.random.default_rng(0))
    assert goals == [(1.4, 4), (1.3, 1), (1.2, 1), (1.1, 1), (1.0, 1)]
    np.testing.assert_allclose(sent, [np.full(6, 1.4 - 1.01)])
