"""Runs of grasps and of insertions in a cell that takes every call: what is taught, counted and pictured."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.papers.gothoskar import figures, grasp, guided_motion, insertion

SEEDS = [3, 4]


def values(rows):
    return {row.name: row.ours for row in rows}


class Cell:
    """A cell that takes every call and keeps how parts were put into the hand and into the hole."""

    def __init__(self):
        self.grasps, self.seats = [], []

    def teach_grasp(self, shift, turn):
        self.grasps.append((*shift, turn))

    def teach_seat(self, shift):
        self.seats.append(shift)

    def __getattr__(self, _):
        return lambda *_, **__: None


@pytest.fixture
def made(monkeypatch):
    """Cells of the seeds, whose arms are learned at once, and the pictures that are drawn."""
    cells, drawn = [], []

    def make(*_, peg=False):
        cells.append(Cell())
        cells[-1].peg = peg
        return cells[-1]

    guide = SimpleNamespace(model=SimpleNamespace(report=SimpleNamespace(mean_error_px=0.6)))
    for module in (grasp, insertion):
        monkeypatch.setattr(module, "make_cell", make)
    monkeypatch.setattr(guided_motion, "learn_arm", lambda *_: guide)
    monkeypatch.setattr(guided_motion, "learn_structure", lambda *_, **__: np.zeros((8, 3)))
    monkeypatch.setattr(figures, "draw_images", lambda path, columns, titles: drawn.append((path.name, titles)))
    return cells, drawn


@pytest.fixture
def arguments(made, tmp_path):
    return Namespace(arm="ur5", tries=3, seeds=SEEDS, samples=50, out=tmp_path)


def test_grasps_are_counted(arguments, monkeypatch):
    outcomes = iter([True, False, True, False, False, True])
    monkeypatch.setattr(grasp, "grasp", lambda *_: next(outcomes))
    rows = grasp.run(arguments)
    assert [(row.ours, row.seeds) for row in rows[:2]] == [(2.0, (3,)), (1.0, (4,))]
    assert values(rows)["ur5: share grasped"] == 0.5
    assert values(rows)["error of the learned arm, worst"] == 0.6


def test_insertions_are_counted_by_their_depth(made, arguments, monkeypatch):
    depths = iter([0.0, 0.036, 0.04, 0.034, 0.01, 0.035])
    monkeypatch.setattr(insertion, "insert", lambda *_: next(depths))
    rows = insertion.run(arguments)
    assert [(row.ours, row.seeds) for row in rows[:2]] == [(2.0, (3,)), (1.0, (4,))]
    assert values(rows)["ur5: share inserted"] == 0.5
    assert [cell.peg for cell in made[0]] == [True] * len(SEEDS)
    assert values(rows)["depth of 40 mm, median"] == pytest.approx(34.5)


@pytest.mark.parametrize(("module", "name"), [(grasp, "grasp"), (insertion, "insert")])
def test_the_first_try_of_the_first_seed_is_pictured(arguments, made, monkeypatch, module, name):
    """A try that is given a list leaves an image of two cameras in it."""
    given = []

    def tried(*arguments):
        frames = arguments[-1]
        given.append(frames is not None)
        if frames is not None:
            frames.append(("left", "right"))
        return 0.0

    monkeypatch.setattr(module, name, tried)
    module.run(arguments)
    assert given == [True, False, False, False, False, False]
    assert made[1] == [(f"{module.__name__.split('.')[-1]}.png", ["seen"])]


@pytest.mark.parametrize(("module", "name"), [(grasp, "grasp"), (insertion, "insert")])
def test_a_part_is_learned_as_it_lies_in_the_middle_of_the_hand(arguments, made, monkeypatch, module, name):
    monkeypatch.setattr(module, name, lambda *_: 0.0)
    module.run(arguments)
    assert [cell.grasps for cell in made[0]] == [[(0.0, 0.0, 0.0, 0.0)]] * 2


def test_a_fixture_is_learned_held_onto_the_peg_with_half_a_millimeter_of_play(arguments, made, monkeypatch):
    """Half of the clearance between a peg of 24 mm and a hole of 25 mm, to either side, all the way down."""

    def learn(guide, markers, rng, samples, hold=None, away=None):
        for _ in range(100 if hold else 0):
            hold()
        return np.zeros((8, 3))

    monkeypatch.setattr(guided_motion, "learn_structure", learn)
    monkeypatch.setattr(insertion, "insert", lambda *_: 0.0)
    insertion.run(arguments)
    for cell in made[0]:
        seats = np.array(cell.seats)
        assert seats.shape == (100, 3)
        assert (seats[:, 2] == 0.0).all()
        assert np.abs(seats).max() <= 0.0005
        assert (seats[:, :2].min(axis=0) < -0.00045).all()
        assert (seats[:, :2].max(axis=0) > 0.00045).all()
