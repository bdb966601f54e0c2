"""Rounds of picks, trials and learning in worlds made by hand: every object once, from its place, with its tools."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.depth import DepthUnobservableError
from dense_vs.errors import DenseVSError
from dense_vs.sims.mobile_manipulator.postures import GRIPPER_BEHIND, above
from dense_vs.sims.papers.vosvs import gripper_geometry, learn, object_pick, pick_place, trial
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
from dense_vs.sims.papers.vosvs.difficulty import DIFFICULTIES
from dense_vs.sims.papers.vosvs.image_tiles import KeptImages
from dense_vs.sims.papers.vosvs.jacobian_learning import Update
from dense_vs.sims.papers.vosvs.object_trial import HEIGHT, PLACES, TRIALS, ObjectTrial
from dense_vs.sims.papers.vosvs.trial_scores import DepthScore, ReachScore, ServoScore

BAR = SimpleNamespace(update=lambda: None, set_description=lambda _: None)
NAMES = [name for names in TRIALS for name in names]


class Room:
    def __init__(self, wide=()):
        self.objects = {name: SimpleNamespace(grip=0.2 if name in wide else 0.05) for name in NAMES}
        self.postures, self.stored, self.events = [], [], []

    def set_posture(self, q):
        self.postures.append(q)

    def store(self, names=None):
        self.stored.append(names)

    def image(self, camera):
        return camera


class Ready:
    def __init__(self, names, seed, threads):
        Ready.made = (names, seed, threads)
        self.world = Room.one

    def pinv(self, name):
        return f"J+ of {name}"

    def segmenter(self, name):
        return f"masks of {name}"

    def learning(self, name, update):
        return SimpleNamespace(pinv=f"{update} of {name}", converged=True)


def test_every_object_that_fits_is_picked_from_its_place(monkeypatch):
    Room.one = world = Room(wide=("Mug", "Plate"))
    picked, placed = [], []

    def pick(world, name, support, segmenter, high, low, method):
        picked.append((name, support, segmenter, high, low, method))
        return SimpleNamespace(placed=name != "Dice")

    monkeypatch.setattr(pick_place, "LearnedSetup", Ready)
    monkeypatch.setattr(pick_place, "above", lambda x, y, height: (x, y, height))
    monkeypatch.setattr(pick_place, "place_objects", lambda world, names, rng: placed.append(names))
    monkeypatch.setattr(pick_place, "forget_images", lambda _: None)
    monkeypatch.setattr(pick_place, "pick_and_place", pick)
    tiles = []
    results = pick_place.run_picks(3, "robust", 2, BAR, tiles)
    assert Ready.made == (None, 3, 2)
    assert placed == list(TRIALS)
    wanted = [name for name in NAMES if name not in ("Mug", "Plate")]
    assert [one[0] for one in picked] == wanted
    assert len(results) == 22
    supports = {name: place[2] for names in TRIALS for name, place in zip(names, PLACES, strict=True)}
    assert all(one[1] == supports[one[0]] for one in picked)
    assert picked[0][2:] == (f"masks of {wanted[0]}", "J+ of base", "J+ of base grasp", "robust")
    assert world.stored == [[name] for name in wanted if name != "Dice"]  # the bin is emptied
    assert [label for label, _ in tiles if label.startswith("Dice")] == ["Dice: not in the bin"]
    assert tiles[0] == (f"{wanted[0]}: in the bin", "grasp")
    starts = [q for q in world.postures if q != (1.0, 0.0, HEIGHT)]
    assert len(world.postures) == 8 + 22
    of = {name: place for names in TRIALS for name, place in zip(names, PLACES, strict=True)}
    off = np.array([np.array(q[:2]) - of[name][:2] for q, name in zip(starts, wanted, strict=True)])
    assert np.abs(off).max() <= 0.12
    assert np.ptp(off, axis=0).min() > 0.15
    assert all(q[2] == HEIGHT for q in starts)


@pytest.mark.parametrize(("grip", "fits"), [(0.999, True), (1.001, False)])
def test_what_fits_the_gripper(monkeypatch, grip, fits):
    Room.one = Room()
    for one in Room.one.objects.values():
        one.grip = grip * pick_place.FITS
    monkeypatch.setattr(pick_place, "LearnedSetup", Ready)
    monkeypatch.setattr(pick_place, "above", lambda *q: q)
    monkeypatch.setattr(pick_place, "place_objects", lambda *_: None)
    monkeypatch.setattr(pick_place, "forget_images", lambda _: None)
    monkeypatch.setattr(pick_place, "pick_and_place", lambda *_, **__: SimpleNamespace(placed=False))
    assert len(pick_place.run_picks(0, "robust", 1, BAR, [])) == (24 if fits else 0)


def test_a_line_of_a_pick():
    one = SimpleNamespace(
        trial=SimpleNamespace(name="Mug", depth=DepthScore(True, -0.034)), grasp=None, placed=True, cause=""
    )
    assert pick_place._line(4, one) == ["4", "Mug", "-3.4", "0", "0", "X", ""]


@pytest.fixture
def trials(monkeypatch):
    """Consecutive trials in a room made by hand; what happened in it."""
    seen = SimpleNamespace(drove=[], located=[], placed=[], clutter=[], reached=[])

    def locate(world, name, support, segmenter, pinv, *, printed_pinv, method, settle_frames, on_look, on_view):
        seen.located.append((name, support, segmenter, pinv, printed_pinv, method, settle_frames))
        if name == "Mug":
            on_look(0, np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), bool))
            on_view(1, np.ones((8, 8, 3), np.uint8), np.zeros((8, 8), bool))
        z_object = {"Mug": 0.2, "Dice": None}.get(name, 0.0)
        approach = (
            None if name == "Washer" else SimpleNamespace(nearest=-1 if name == "Knife" else 0, z_object=z_object)
        )
        return ObjectTrial(name, support, ServoScore(name == "Mug"), approach=approach)

    def reach(world, name, segmenter, pinv, z_object):
        seen.reached.append((name, segmenter, pinv, z_object, len(world.put_back)))
        return ReachScore(z_object == 0.2)

    def printed(approach):
        if approach.z_object is None:
            raise DepthUnobservableError("no depth")
        return 0.5 + approach.z_object

    def make(names=trial.NAMES, kept=None):
        world = Room()
        world.put_back = []
        world.remember = lambda: lambda: world.put_back.append(len(seen.reached))
        ready = SimpleNamespace(
            seed=5,
            world=world,
            difficulty=DIFFICULTIES["hard"],
            pinv=lambda name: f"J+ of {name}",
            learning=lambda name, update=None: SimpleNamespace(pinv=f"{update} of {name}", converged=True),
            segmenter=lambda name: f"masks of {name}",
            add_clutter=lambda names, rng: seen.clutter.append(tuple(names)),
        )
        one = trial.ConsecutiveTrials(ready, names, "vos-de", kept or KeptImages(None))
        assert [learning.pinv for learning in one.learn()] == ["None of base", "(11) as printed of base"]
        seen.results = one.run(BAR)
        seen.world, seen.tiles = world, one.tiles
        return seen

    monkeypatch.setattr(trial, "ManipulatorRobot", lambda world: "robot")
    monkeypatch.setattr(trial, "place_objects", lambda world, names, rng, only: seen.placed.append((names, only)))
    monkeypatch.setattr(trial, "drive_to", lambda robot, place, rng: seen.drove.append(place))
    monkeypatch.setattr(trial, "locate", locate)
    monkeypatch.setattr(trial, "reach_depth", reach)
    monkeypatch.setattr(trial, "printed_depth", printed)
    return make


def test_the_trials_are_one_run(trials):
    seen = trials()
    assert seen.placed == [(names, trial.NAMES) for names in TRIALS]
    assert seen.clutter == list(TRIALS)
    assert seen.drove == list(PLACES) * 8
    assert [one[0] for one in seen.located] == NAMES
    assert [one[1] for one in seen.located] == [place[2] for place in PLACES] * 8
    assert seen.located[0][2:] == (f"masks of {NAMES[0]}", "J+ of base", "(11) as printed of base", "vos-de", 0)
    assert len(seen.world.postures) == 1  # it is never put back
    np.testing.assert_array_equal(seen.world.postures[0], above(1.0, 0.0, HEIGHT))
    assert [one.name for one in seen.results] == NAMES
    ((label, image),) = seen.tiles
    assert label == "Mug: VS yes, DE yes"
    assert image.max() == 1  # the last view


def test_depth_is_done_by_both_from_one_place(trials):
    seen = trials()
    of = {one.name: one for one in seen.results}
    mug = [one for one in seen.reached if one[0] == "Mug"]
    before = mug[0][4]
    assert mug == [
        ("Mug", "masks of Mug", "J+ of base grasp", 0.7, before),
        ("Mug", "masks of Mug", "J+ of base grasp", 0.2, before + 1),  # everything was put back between them
    ]
    assert of["Mug"].reach.closed
    assert not of["Mug"].printed_reach.closed
    names = [one[0] for one in seen.reached]
    assert not {"Washer", "Knife", "Dice"} & set(names)  # never approached, no view of it, no depth
    assert of["Dice"].printed_reach == ReachScore(closed=False, lifted=False, cause="depth: no depth")
    assert names.count("Plate") == 2


def test_some_of_the_objects(trials, tmp_path):
    seen = trials(("Mug", "Dice"), KeptImages(tmp_path / "kept"))
    assert [names for names, _ in seen.placed] == [TRIALS[4], TRIALS[7]]
    assert {only for _, only in seen.placed} == {("Mug", "Dice")}
    assert seen.clutter == [("Mug",), ("Dice",)]
    assert [one.name for one in seen.results] == ["Mug", "Dice"]
    assert seen.drove == [PLACES[0], PLACES[1]]
    files = sorted(path.name for path in (tmp_path / "kept").iterdir())
    stems = [f"hard_5_Mug_00{k}" for k in range(2)]
    assert files == sorted([f"{stem}{end}.png" for stem in stems for end in ("", "_mask")])


def test_what_was_asked_for():
    assert trial.chosen_objects(None) == tuple(NAMES)
    assert trial.chosen_objects(["Dice", "Mug", "Dice"]) == ("Mug", "Dice")
    with pytest.raises(DenseVSError, match="object 'Hammer' is not one of the trials'"):
        trial.chosen_objects(["Mug", "Hammer"])
    asked = SimpleNamespace(difficulty="clean", mask_seconds=None)
    assert trial.chosen_difficulty(asked) is DIFFICULTIES["clean"]
    asked = SimpleNamespace(difficulty="hard", mask_seconds=0.0)
    assert trial.chosen_difficulty(asked) == replace(DIFFICULTIES["hard"], mask_seconds=0.0)
    for seconds in (-0.1, 0.5, float("nan")):
        with pytest.raises(DenseVSError, match="--mask-seconds"):
            trial.chosen_difficulty(SimpleNamespace(difficulty="hard", mask_seconds=seconds))


def test_every_configuration_is_learned_with_every_update(monkeypatch):
    asked = []

    def configured(world, one, name, segmenter, rng, *, update, responses, looks, keep_images):
        asked.append((one.name, update, float(rng.random()), keep_images, responses, looks, segmenter))
        number = CONFIGURATIONS.index(one)
        truths = [] if one.name == "head" else [number * one.coupling, (number + 2) * one.coupling]
        return SimpleNamespace(true=truths)

    monkeypatch.setattr(
        learn, "MobileWorld", lambda names, seed, threads: SimpleNamespace(store=lambda: None, names=names)
    )
    monkeypatch.setattr(learn, "learn_segmenter", lambda world, name, seed: f"masks of {name}")
    monkeypatch.setattr(learn, "learn_configuration", configured)
    monkeypatch.setattr(learn, "ManipulatorRobot", lambda world: None)
    units = SimpleNamespace(units=("m", "rad"))
    monkeypatch.setattr(learn, "JointGroup", SimpleNamespace(of_robot=lambda robot, joints: units))
    found = learn.learn_all(6, 5, 150, 1, BAR)
    assert [one.one for one in found] == list(CONFIGURATIONS)
    assert [one[:2] for one in asked] == [(one.name, update) for one in CONFIGURATIONS for update in Update]
    assert all(one[4:6] == (5, 150) for one in asked)
    assert [one[:2] for one in asked if one[3]] == [("base", Update.GUARDED)]
    draws = [one[2] for one in asked]
    for k in range(7):  # every update sees the object in the same places
        assert len(set(draws[4 * k : 4 * k + 4])) == 1
    assert len(set(draws)) == 7
    assert np.isnan(found[0].true).all()
    np.testing.assert_allclose(found[2].true, 3 * CONFIGURATIONS[2].coupling)
    assert found[0].true.shape == CONFIGURATIONS[0].coupling.shape


def test_the_part_of_the_error_that_a_step_removes():
    one = CONFIGURATIONS[3]  # two joints for s_x, one for s_y
    true = np.array([[0.002, 0.0], [0.004, 0.0], [0.0, 0.005]])
    pinv = np.array([[0.001, 0.0], [0.001, 0.0], [0.0, 0.004]])
    learned = SimpleNamespace(one=one, true=true, outcomes={Update.GUARDED: SimpleNamespace(pinv=pinv)})
    np.testing.assert_allclose(learn.removed(learned, Update.GUARDED), [0.75, 0.8])


def test_what_is_held_is_carried_above_the_bin():
    names = ("base_roll", "base_forward", "base_lateral", "arm_lift", "wrist")
    robot = SimpleNamespace(joint_names=names, q=np.array([0.3, -1.0, 2.0, 0.2, 0.7]), sent=[])

    def command(delta):
        robot.sent.append(np.array(delta))
        robot.q = robot.q + delta

    robot.joints, robot.command = lambda: (robot.q.copy(), 0.0), command
    waited = []
    goal = np.array([9.0, 5.0, 6.0, 9.0, 9.0])
    asked = []
    import unittest.mock

    with unittest.mock.patch.object(object_pick, "above", lambda *place: asked.append(place) or goal):
        object_pick.carry_to_bin(SimpleNamespace(wait=waited.append), robot)
    np.testing.assert_allclose(robot.q, [0.3, 5.0, 6.0, 0.5, 0.7])
    np.testing.assert_allclose(robot.sent[0], [0, 0, 0, 0.72 - 0.2, 0])  # up first
    np.testing.assert_allclose(robot.sent[1], [0, 6.0, 4.0, 0, 0])
    np.testing.assert_allclose(robot.sent[2], [0, 0, 0, 0.5 - 0.72, 0])
    assert asked == [(0.92 + GRIPPER_BEHIND, -1.4, 0.5)]  # the bin's front, behind which the gripper is
    assert waited == [10]


def test_the_gripper_s_fingers_stand_on_either_side_of_its_axis():
    """In the grasp camera's image, 480 x 640; the gripper stands behind the camera's axis."""
    K = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])
    world = SimpleNamespace(intrinsics=lambda camera: K if camera == "grasp" else None)
    hand = gripper_geometry.hand_geometry(world)
    assert hand.target == (220.0, 240.0)
    assert hand.center == (320.0, 240.0)
    pose = hand.model.T_camera_hand
    np.testing.assert_allclose(np.linalg.det(pose[:3, :3]), 1.0)
    np.testing.assert_allclose(pose[:3, 0], [0, 1, 0])  # the closing motion is image y
    assert pose[0, 3] < 0 < pose[2, 3]
    mask = gripper_geometry.fingers_in_view(world)
    assert mask.shape == (480, 640)
    y, x = np.nonzero(mask)
    assert 0.001 < mask.mean() < 0.2
    assert x.mean() < 320
    assert y.mean() == pytest.approx(239.5, abs=3)
    assert not mask[230:250].all(axis=0).any()  # room between the fingers
