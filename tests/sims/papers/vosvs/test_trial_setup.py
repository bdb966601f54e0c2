"""The room of a difficulty, and a hard trial of one object in it with true masks."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.sims.mobile_manipulator.annotations import SUPPORTS
from dense_vs.sims.mobile_manipulator.clutter_objects import clutter_met_in_trials
from dense_vs.sims.papers.vosvs import trial_setup
from dense_vs.sims.papers.vosvs.difficulty import DIFFICULTIES
from dense_vs.sims.papers.vosvs.image_tiles import KeptImages
from dense_vs.sims.papers.vosvs.object_trial import place_objects
from dense_vs.sims.papers.vosvs.timed_segmenter import TimedSegmenter
from dense_vs.sims.papers.vosvs.trial import ConsecutiveTrials
from dense_vs.sims.papers.vosvs.trial_setup import TrialSetup

NAME = "Foam Brick"
PINV = {"base": np.diag([-0.0018, 0.0018]), "base grasp": np.diag([-0.0004, 0.0004])}


class TrueMasks:
    world = None

    def __init__(self, name):
        self.name = name

    def segment(self, image):
        return TrueMasks.world.true_mask("grasp", self.name)


@pytest.fixture
def elsewhere(monkeypatch):
    """Masks that were learned elsewhere are the true ones; what was asked for."""
    asked = []

    def learn(names, seed, threads, jobs):
        asked.append((tuple(names), seed, threads, jobs))
        return {name: TrueMasks(name) for name in names}

    monkeypatch.setattr(trial_setup, "learn_segmenters", learn)
    return asked


@pytest.mark.slow
def test_a_hard_trial(elsewhere, monkeypatch):
    ready = TrialSetup([NAME], 3, DIFFICULTIES["hard"], threads=1, jobs=5)
    assert elsewhere == [((NAME, "Plastic Chain", "Tuna"), 3, 1, 5)]  # those that J+ is learned with too
    world = TrueMasks.world = ready.world
    assert set(world.objects) == {NAME, "Plastic Chain", "Tuna", *clutter_met_in_trials()}
    segmenter = ready.segmenter(NAME)
    assert isinstance(segmenter, TimedSegmenter)
    assert segmenter is ready.segmenter(NAME)
    before = world.time
    segmenter.segment(world.image("grasp"))
    assert world.time == pytest.approx(before + 0.2)
    monkeypatch.setattr(ready, "pinv", PINV.__getitem__)
    monkeypatch.setattr(ready, "learning", lambda name, update=None: SimpleNamespace(pinv=PINV[name]))
    one = ConsecutiveTrials(ready, (NAME,), "robust", KeptImages(None))
    one.learn()
    (result,) = one.run(SimpleNamespace(set_description=lambda _: None, update=lambda: None))
    assert result.cause == ""
    assert result.servo.centered
    assert result.printed_servo is not None
    assert result.printed_servo.centered
    assert result.depth.graspable
    assert result.reach.closed
    assert result.reach.lifted
    assert result.iou == (1.0, 1.0)  # of the images, though the robot and the world moved on since
    assert abs(result.depth.error) < 0.02
    assert len(one.tiles) == 1


def test_clutter_stands_on_every_support(elsewhere):
    ready = TrialSetup([NAME], 4, DIFFICULTIES["hard"], threads=1)
    rng, names = np.random.default_rng(0), ("Tuna", NAME, "Tuna")
    place_objects(ready.world, names, rng, [NAME])
    placed = ready.add_clutter([NAME], rng)
    assert len(set(placed)) == len(placed) >= 5
    heights = np.array([ready.world.lowest_point(name) for name in placed])
    on = [int(np.sum(np.abs(heights - z) < 0.01)) for _, _, z in SUPPORTS]
    assert sum(on) == len(placed)
    assert min(on) >= 1
    assert max(on) == 2
    stored = set(clutter_met_in_trials()) - set(placed)
    assert all(ready.world.object_position(name)[0] < -3 for name in stored)


def test_a_clean_trial_is_that_of_before(elsewhere, monkeypatch):
    def learn_here(world, names, seed, jobs):
        assert (world.objects.keys(), seed, jobs) == (set(names), 3, 2)
        return {name: f"masks of {name} in its own room" for name in names}

    monkeypatch.setattr(trial_setup, "learn_segmenters_here", learn_here)
    ready = TrialSetup([NAME], 3, DIFFICULTIES["clean"], threads=1, jobs=2)
    assert elsewhere == []
    assert ready.segmenter(NAME) == f"masks of {NAME} in its own room"
    assert not set(ready.world.objects) & set(clutter_met_in_trials())
    time = ready.world.time
    assert ready.add_clutter([NAME], np.random.default_rng(0)) == []
    assert ready.world.time == time


@pytest.mark.parametrize("difficulty", ["hard", "clean"])
def test_masks_take_time_where_the_trials_are_hard(difficulty):
    """Each object's segmenter is made once; what it has seen before counts."""
    ready = TrialSetup.__new__(TrialSetup)
    ready.world, ready.difficulty, ready._timed = "world", DIFFICULTIES[difficulty], {}
    ready._segmenters = {"Mug": TrueMasks("Mug"), "Tuna": TrueMasks("Tuna")}
    one, other = ready.segmenter("Mug"), ready.segmenter("Tuna")
    assert ready.segmenter("Mug") is one
    assert ready.segmenter("Tuna") is other
    assert one is not other
    assert isinstance(one, TimedSegmenter) == (difficulty == "hard")
    assert (one is ready._segmenters["Mug"]) == (difficulty == "clean")


@pytest.mark.parametrize(("difficulty", "fits"), [("hard", True), ("hard", False), ("clean", True)])
def test_each_support_gets_its_own_clutter(monkeypatch, difficulty, fits):
    """Two things each, that no other has; on the bins within their rims, on the floor about the object."""
    scattered, waited = [], []

    def scatter(world, names, region, others, rng, gap):
        scattered.append(((*region.middle, region.height), region.half, list(names)))
        assert (others, gap) == (("Mug", "Dice"), 0.04)
        return list(names) if fits else []

    monkeypatch.setattr(trial_setup, "scatter", scatter)
    ready = TrialSetup.__new__(TrialSetup)
    ready.world, ready.difficulty = SimpleNamespace(wait=waited.append), DIFFICULTIES[difficulty]
    placed = ready.add_clutter(("Mug", "Dice"), np.random.default_rng(0))
    if difficulty == "clean":
        assert (scattered, placed, waited) == ([], [], [0])
        return
    assert [one[:2] for one in scattered] == [
        (place, (0.17, 0.22) if place[2] > 0 else (0.2, 0.26)) for place in SUPPORTS
    ]
    assert [len(names) for *_, names in scattered] == [2, 2, 2]
    things = [name for *_, names in scattered for name in names]
    assert len(set(things)) == 6
    assert (placed, waited) == (things if fits else [], [15 if fits else 0])


def test_the_difficulties():
    hard, clean = DIFFICULTIES["hard"], DIFFICULTIES["clean"]
    assert hard.other_rooms
    assert hard.shadows
    assert hard.clutter == 2
    assert hard.mask_seconds == 0.2
    assert (clean.other_rooms, clean.shadows, clean.clutter, clean.mask_seconds) == (False, False, 0, 0.0)
    assert (hard.settle_frames, clean.settle_frames) == (0, 6)
