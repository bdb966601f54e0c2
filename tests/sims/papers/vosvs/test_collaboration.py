"""A person who brings a thing, in the simulator; the errand around it and its figures, in worlds made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.model import JOINTS
from dense_vs.sims.mobile_manipulator.person import Person, add_person
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs import collaboration
from dense_vs.sims.papers.vosvs.bringing_person import BringingPerson
from dense_vs.sims.papers.vosvs.collaboration import Errand
from dense_vs.sims.papers.vosvs.object_pick import Pick
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial
from dense_vs.sims.papers.vosvs.tracking import Track

IMAGE, MASK = np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), bool)
TARGET = np.array([320.0, 240.0])


def test_a_thing_is_brought_and_put_down():
    world = MobileWorld(["Box of Sugar", "Tuna"], seed=4, device="cpu", additions=(add_person,))
    world.store()
    person, goal, robot = Person(world), np.array([0.6, 2.3]), (-1.5, 2.5)
    walk = BringingPerson(world, person, "Box of Sugar", (1.6, 3.4), goal, robot)
    world.before_frame = walk
    heights = []
    for _ in range(60):
        world.wait(10)
        heights.append(world.object_center("Box of Sugar")[2])
        if walk.done:
            break
    world.before_frame = None
    assert walk.done
    assert max(heights) > 0.9  # carried, not dragged
    world.wait(10)
    x, y, z = world.object_center("Box of Sugar")
    np.testing.assert_allclose([x, y], goal, atol=0.08)
    assert z == pytest.approx(0.0875, abs=0.01)
    upright = world.state.body("box_of_sugar").xmat.reshape(3, 3)[2, 2]
    assert upright > 0.99
    assert person.held is None
    away = walk.walker.place - robot
    assert np.hypot(*away) > np.hypot(*(goal - robot)) + 1.0  # stepped back, behind it
    assert walk.walker.traveled > 2.0


def track(offsets, lost=0):
    return Track("head", 0, TARGET + np.array(offsets, dtype=float), TARGET, lost, 1.0, [])


def pick(placed):
    return Pick(ObjectTrial("Softscrub", 0.0), placed=placed, cause="" if placed else "slipped")


def test_what_is_as_far_off_as_the_hand_sees_is_not_found():
    assert [
        Errand(track([[0, 0]]), off).found for off in (collaboration.FOUND - 1e-9, collaboration.FOUND, np.nan)
    ] == [True, False, False]


def test_rows_of_errands():
    nan = [np.nan, np.nan]
    errands = {
        5: [Errand(track([[3, -10], [0, 4]], 1), 0.1, pick(True)), Errand(track([[0, 0], nan], 2))],
        6: [Errand(track([[20, 1]]), 0.36, pick(False)), Errand(track([[1, 1]]), 0.34, pick(True))],
    }
    rows = {(row.name, row.seeds): row.ours for row in collaboration.table_rows(errands)}
    assert rows["found where the person put it, of 2", (5,)] == 1
    assert rows["found where the person put it, of 2", (6,)] == 1
    assert rows["in the bin, of 2", (5,)] == 1
    assert rows["in the bin, of 2", (6,)] == 1
    assert rows["place by the head's gaze, off by, median", (5, 6)] == pytest.approx(0.34)
    assert rows["looks with the person in view", (5, 6)] == pytest.approx(100 * 5 / 6)
    assert rows["person: true error, median", (5, 6)] == 4.0
    assert rows["times the person was lost", (5, 6)] == 3
    lines = collaboration._lines(errands)
    assert lines[0] == ["5", "Softscrub", "0.10", "X", ""]
    assert lines[1] == ["5", "Box of Sugar", "nan", "", "the head did not find it"]
    assert lines[2] == ["6", "Softscrub", "0.36", "", "slipped"]


def searched(monkeypatch, found, end):
    made = {}

    def search(camera, robot, segmenter, *, joints, reach):
        made.update(searched=joints, reach=reach)
        return SimpleNamespace(found=found)

    class Servo:
        def __init__(self, camera, robot, segmenter, **options):
            made.update(options)

        def run(self, looks):
            made["on_look"](None, IMAGE, MASK)
            return SimpleNamespace(end=end)

    robot = SimpleNamespace(joints=lambda: ("q", 0.0))
    monkeypatch.setattr(collaboration, "search_object", search)
    monkeypatch.setattr(collaboration, "MaskServo", Servo)
    monkeypatch.setattr(collaboration, "ManipulatorRobot", lambda world: robot)
    monkeypatch.setattr(collaboration, "gaze_on_floor", lambda q, height: (q, height))
    tiles = []
    return collaboration.find_thing("world", "Softscrub", "masks", "J+", tiles), made, tiles


def test_the_head_looks_around_and_centers(monkeypatch):
    place, made, tiles = searched(monkeypatch, True, ServoEnd.CONVERGED)
    assert place == ("q", 0.06)
    assert made["searched"] == made["joints"] == ("head_pan", "head_tilt")
    assert made["reach"] == (0.45, 0.35)
    assert made["pinv"] == "J+"
    assert [label for label, _ in tiles] == ["Softscrub: found with the head"]


@pytest.mark.parametrize("end", [ServoEnd.LOST, ServoEnd.EXHAUSTED, ServoEnd.AT_LIMIT])
def test_what_is_not_centered_has_no_place(monkeypatch, end):
    assert searched(monkeypatch, True, end)[0] is None


def test_what_is_not_seen_is_not_servoed_to(monkeypatch):
    place, made, _ = searched(monkeypatch, False, ServoEnd.CONVERGED)
    assert place is None
    assert "pinv" not in made


def watched(monkeypatch, done_after, most=12):
    walk = SimpleNamespace(done=False, name="Softscrub", walker=SimpleNamespace(traveled=3.0))
    world, calls = SimpleNamespace(before_frame=None), []

    def follow(world, one, shirt, pinv, looks, *, max_step, true_place, mask_seconds):
        assert world.before_frame is walk
        calls.append((one.name, shirt, pinv, looks, max_step, mask_seconds))
        walk.done = len(calls) >= done_after
        return np.full((looks, 2), float(len(calls))), 1, [("a", IMAGE)]

    monkeypatch.setattr(collaboration, "follow", follow)
    person, tiles = SimpleNamespace(geoms=lambda cloth: cloth), []
    one = collaboration.watch_person(world, person, walk, "shirt", "J+", tiles)
    assert world.before_frame is None
    return one, calls, tiles


def test_the_person_is_followed_until_done(monkeypatch):
    one, calls, tiles = watched(monkeypatch, 3)
    assert calls == [("head", "shirt", "J+", collaboration.LOOKS, 0.3, 0.2)] * 3
    assert len(one.centroids) == 3 * collaboration.LOOKS
    assert (one.lost, one.traveled) == (3, 3.0)
    assert [label for label, _ in tiles] == ["Softscrub, shown, look 1", "Softscrub, shown, look 17"]
    assert len(watched(monkeypatch, 99)[1]) == collaboration.MOST


def errand(monkeypatch, place, placed=True):
    sent, picked, waiting = [], [], {}
    robot = SimpleNamespace(joints=lambda: (np.arange(10.0), 0.0), command=sent.append)
    world = SimpleNamespace(
        set_posture=lambda q: waiting.update(zip(JOINTS, q, strict=True)),
        object_center=lambda name: np.array([0.6, 2.0, 0.1]),
        image=lambda camera: IMAGE,
    )
    made = []

    def pick_it(world, name, support, segmenter, high, low, *, on_look, on_attempt):
        picked.append((name, support, segmenter, high, low))
        on_look(0, IMAGE, MASK)
        on_attempt(SimpleNamespace(check=SimpleNamespace(outcome=SimpleNamespace(value="held"))))
        return pick(placed)

    monkeypatch.setattr(collaboration, "BringingPerson", lambda *told: made.append(told) or "walk")
    monkeypatch.setattr(collaboration, "watch_person", lambda *_: track([[0, 0]]))
    monkeypatch.setattr(collaboration, "find_thing", lambda *_: place)
    monkeypatch.setattr(collaboration, "ManipulatorRobot", lambda world: robot)
    monkeypatch.setattr(collaboration, "above", lambda x, y, height: np.array([x, y, height, *[0.0] * 7]))
    monkeypatch.setattr(collaboration, "pick_and_place", pick_it)
    pinvs, tiles = {"head": "h", "base": "high", "base grasp": "low"}, []
    rng = np.random.default_rng(3)
    one = collaboration.run_errand(world, "person", "Softscrub", "shirt", "masks", pinvs, rng, tiles)
    assert (waiting["base_forward"], waiting["base_lateral"], waiting["head_tilt"]) == (-1.5, 2.5, -0.1)
    return one, sent, picked, tiles, made


def test_the_robot_drives_to_where_the_head_looked(monkeypatch):
    one, sent, picked, tiles, made = errand(monkeypatch, np.array([0.9, 2.4]))
    assert one.off == pytest.approx(0.5)
    assert not one.found
    assert one.placed
    np.testing.assert_allclose(sent[0] + np.arange(10), [0.9, 2.4, collaboration.HEIGHT, *[0.0] * 7])
    assert picked == [("Softscrub", 0.0, "masks", "high", "low")]
    labels = [label for label, _ in tiles]
    assert labels == ["Softscrub: centered by the base", "Softscrub: held", "Softscrub: in the bin"]
    *_, start, goal, toward = made[0]
    assert (start, toward) == ((1.9, 3.6), (-1.5, 2.5))
    assert all(low <= value <= high for value, (low, high) in zip(goal, ((0.3, 0.9), (1.7, 3.3)), strict=True))
    near = errand(monkeypatch, np.array([0.7, 2.2]), placed=False)[0]
    assert near.found
    assert not near.placed


def test_an_errand_ends_where_the_head_finds_nothing(monkeypatch):
    one, sent, picked, _, _ = errand(monkeypatch, None)
    assert not one.found
    assert not one.placed
    assert sent == picked == []
