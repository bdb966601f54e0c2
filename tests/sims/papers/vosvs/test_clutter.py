"""The heap: what is asked for, where it is looked for, and how the results are counted, in a world made by hand."""

from types import SimpleNamespace

import numpy as np

from dense_vs.grasp import GraspCheck, GraspOutcome, WristVerdict
from dense_vs.grasp.loop import GraspAttempt, GraspRun
from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.poured_objects import ASIDE, FLOOR, TRAY
from dense_vs.sims.papers.vosvs import clutter
from dense_vs.sims.papers.vosvs.clutter import Request
from dense_vs.sims.papers.vosvs.object_pick import BIN, Pick
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial

IMAGE, MASK = np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), bool)


def attempt(outcome):
    return GraspAttempt(ServoEnd.CONVERGED, WristVerdict.CLEAR, 0.0, False, 0.05, GraspCheck(outcome, 1.0), (1.0, 1.0))


def pick(outcomes, truly, placed, cause=""):
    run = GraspRun([attempt(one) for one in outcomes], held=placed)
    return Pick(ObjectTrial("Tuna", 0.0), run, list(truly), placed, cause)


HELD, MISSED, WRONG = GraspOutcome.HELD, GraspOutcome.MISSED, GraspOutcome.WRONG


def test_rows_of_a_heap():
    good = Request("Tuna", [pick([HELD], [True], True)])
    late = Request("Marker", [pick([WRONG, MISSED], [False, False], False, "lost"), pick([HELD], [True], True)])
    wrong = Request("Gelatin", [pick([HELD], [False], False, "slipped"), Pick(ObjectTrial("Gelatin", 0.0))], ["Tuna"])
    nothing = Request("Foam Brick")
    rows = {(row.name, row.seeds): row for row in clutter.table_rows({5: [good, late], 6: [wrong, nothing]})}
    assert rows["in the bin, of 2 asked for", (5,)].ours == 2
    assert rows["in the bin, of 2 asked for", (6,)].ours == 0
    assert rows["wrong objects in the bin", (5, 6)].ours == 1
    assert rows["attempts", (5, 6)].ours == 5
    assert rows["grasps of another object, put aside", (5, 6)].ours == 1
    assert rows["grasp check right", (5, 6)].ours == 80.0
    assert rows["grasp checks", (5, 6)].ours == 5
    assert rows["grasp check right", (5, 6)].unit == "%"
    assert clutter._line(5, late) == ["5", "Marker", "3", "1", "X", "", ""]
    assert clutter._line(6, wrong) == ["6", "Gelatin", "1", "0", "", "Tuna", "slipped; "]
    empty = {row.name: row.ours for row in clutter.table_rows({1: [nothing]})}
    assert np.isnan(empty["grasp check right"])


def test_four_are_asked_for_the_banana_first():
    drawn = [clutter.asked_for(np.random.default_rng(seed)) for seed in range(20)]
    assert all(names[0] == "Plastic Banana" and len(set(names)) == 4 for names in drawn)
    assert {name for names in drawn for name in names} == set(clutter.OBJECTS)


class Bin:
    """A world in which objects lie in the bin or elsewhere."""

    def __init__(self, *inside):
        self.inside = list(inside)

    def object_center(self, name):
        return np.array([*BIN, 0.1]) if name in self.inside else np.array([*TRAY, FLOOR])

    def image(self, camera):
        return IMAGE


def ask(monkeypatch, world, results):
    drove, asked, tiles = [], [], []

    def picked(world, name, support, segmenter, high, low, *, others, aside, policy, on_look, on_attempt):
        asked.append((name, support, segmenter, high, low, tuple(others), aside))
        assert policy._attempts == 5
        on_look(0, IMAGE, MASK)
        on_attempt(attempt(WRONG))
        on_attempt(attempt(HELD))
        placed = results.pop(0)
        if placed:
            world.inside.append(name)
        return pick([HELD], [placed], placed)

    monkeypatch.setattr(clutter, "ManipulatorRobot", lambda world: "robot")
    monkeypatch.setattr(clutter, "drive_to", lambda robot, place, rng: drove.append(place))
    monkeypatch.setattr(clutter, "pick_and_place", picked)
    segmenters = {name: f"masks of {name}" for name in clutter.OBJECTS}
    request = clutter.fulfil(world, "Tuna", segmenters, ("high", "low"), np.random.default_rng(0), tiles)
    return request, drove, asked, tiles


def test_what_is_found_in_the_tray_is_not_looked_for_elsewhere(monkeypatch):
    request, drove, asked, tiles = ask(monkeypatch, Bin(), [True])
    assert request.placed
    assert request.wrong == []
    assert drove == [(*TRAY, FLOOR)]
    assert asked[0][:5] == ("Tuna", FLOOR, "masks of Tuna", "high", "low")
    assert asked[0][5] == tuple(f"masks of {name}" for name in clutter.OBJECTS if name != "Tuna")
    assert asked[0][6] == ASIDE
    assert [label for label, _ in tiles] == ["Tuna: centered", "Tuna: wrong", "Tuna: held"]


def test_things_are_put_aside_beside_the_tray(monkeypatch):
    monkeypatch.setattr(clutter, "ASIDE", (0.25, -0.5))
    monkeypatch.setattr(clutter, "TRAY", (1.0, 1.5))
    _, drove, asked, _ = ask(monkeypatch, Bin(), [False, True])
    assert drove == [(1.0, 1.5, FLOOR), (1.25, 1.0, FLOOR)]
    assert asked[1][6] == (0.25, -0.5)


def test_what_fails_is_looked_for_where_things_are_put_aside(monkeypatch):
    request, drove, _, _ = ask(monkeypatch, Bin(), [False, True])
    assert request.placed
    assert drove == [(*TRAY, FLOOR), (TRAY[0] + ASIDE[0], TRAY[1] + ASIDE[1], FLOOR)]
    request, drove, _, _ = ask(monkeypatch, Bin("Marker"), [False, False, False])
    assert not request.placed
    assert len(drove) == len(request.picks) == 3
    assert drove[2] == drove[0]
    assert request.wrong == ["Marker"]


def test_the_bin_is_emptied_after_every_object(monkeypatch):
    world = Bin()
    stored, poured = [], []
    world.store = lambda names=None: stored.append(names) or (names and world.inside.clear())
    world.set_posture = lambda q: None

    def made(names, seed, threads, additions):
        assert additions == (clutter.add_tray,)
        assert sorted(names) == sorted({*clutter.OBJECTS, "Plastic Chain", "Tuna"})
        pinv = {"base": "high", "base grasp": "low"}
        return SimpleNamespace(world=world, pinv=pinv.get, segmenter=lambda name: f"masks of {name}")

    def fulfilled(world, name, segmenters, pinvs, rng, tiles):
        assert pinvs == ("high", "low")
        world.inside.append(name)
        return Request(name, [pick([HELD], [True], True)])

    monkeypatch.setattr(clutter, "LearnedSetup", made)
    monkeypatch.setattr(clutter, "pour", lambda world, names, rng: poured.append(tuple(names)))
    monkeypatch.setattr(clutter, "_all_masks", lambda *_: IMAGE)
    monkeypatch.setattr(clutter, "fulfil", fulfilled)
    bar = SimpleNamespace(update=lambda: None, set_description=lambda _: None)
    tiles = []
    results = clutter.clear_tray(3, 1, bar, tiles)
    assert poured == [clutter.OBJECTS]
    assert len(results) == clutter.ASKED
    assert stored == [None, *[[one.name] for one in results]]
    assert len(tiles) == 1
