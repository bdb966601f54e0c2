"""The steps of a trial and of learning J+, with servos, searches and truths that say how they end."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.depth.approach import Approach, ApproachEnd
from dense_vs.errors import DenseVSError
from dense_vs.mask_servo.loop import ServoEnd, ServoRun
from dense_vs.sims.mobile_manipulator.postures import CAMERA_ABOVE_LIFT
from dense_vs.sims.papers.vosvs import object_trial
from dense_vs.sims.papers.vosvs.object_trial import (
    PLACES,
    TRIALS,
    ObjectTrial,
    _center,
    _estimate_depth,
    _heap_chain,
    drive_to,
    locate,
    place_objects,
)
from dense_vs.sims.papers.vosvs.trial_scores import DepthScore, ServoScore, TrueView, intersection_over_union


class Room:
    """Objects are where they are put; a chain hangs as low as told, time after time."""

    def __init__(self, lowest=()):
        links = {"Plastic Chain": 9}
        self.objects = {name: SimpleNamespace(links=links.get(name, 0)) for names in TRIALS for name in names}
        self.placed, self.chains, self.stored, self.lowest = {}, [], 0, list(lowest)

    def store(self):
        self.stored += 1
        self.placed.clear()

    def place(self, name, place, turn):
        self.placed[name] = (*place, turn)

    def lay_chain(self, name, place, rng):
        self.chains.append(place)

    def lowest_point(self, name):
        return self.lowest.pop(0)


def test_the_published_trials():
    assert len({name for names in TRIALS for name in names}) == 24
    assert [place[2] for place in PLACES] == sorted((place[2] for place in PLACES), reverse=True)
    assert PLACES[2][2] == 0.0


def test_a_trial_s_objects_stand_on_their_supports():
    offsets, turns, rng = [], [], np.random.default_rng(0)
    for _ in range(60):
        room = Room()
        place_objects(room, TRIALS[0], rng)
        assert room.stored == 1
        for name, (x, y, z) in zip(TRIALS[0], PLACES, strict=True):
            px, py, pz, turn = room.placed[name]
            assert pz == z
            offsets.append((px - x, py - y))
            turns.append(turn)
    offsets = np.array(offsets)
    assert np.abs(offsets).max() <= 0.06
    assert (offsets.max(axis=0) > 0.05).all()
    assert (offsets.min(axis=0) < -0.05).all()
    assert max(turns) > 3
    assert min(turns) < -3


@pytest.mark.parametrize("only", [["Marker"], ["Padlock", "Power Drill"], []])
def test_only_the_objects_that_are_asked_for_stand_on_their_supports(only):
    room = Room()
    place_objects(room, TRIALS[0], np.random.default_rng(1), only)
    assert room.stored == 1
    assert sorted(room.placed) == sorted(only)
    for name, (x, y, z) in zip(TRIALS[0], PLACES, strict=True):
        if name in only:
            np.testing.assert_allclose(room.placed[name][:3], (x, y, z), atol=0.06)


def test_a_chain_lies_in_the_middle_of_its_support_and_does_not_hang_over():
    height = PLACES[1][2]
    room = Room([height - 0.0051, height - 0.2, height - 0.0049])
    place_objects(room, TRIALS[6], np.random.default_rng(0))
    assert room.chains == [PLACES[1]] * 3
    assert set(room.placed) == {"Baseball", "Washer"}
    with pytest.raises(DenseVSError, match="hung over the edge of its support in 4 tries"):
        _heap_chain(Room([-1.0] * 4), "Plastic Chain", (0.0, 0.0, 0.1), np.random.default_rng(0), tries=4)


def test_the_robot_drives_to_about_where_a_support_is(monkeypatch):
    monkeypatch.setattr(object_trial, "above", lambda x, y, height: np.array([x, y, height]))
    sent = []
    robot = SimpleNamespace(joints=lambda: (np.array([0.5, 0.25, 0.1]), 0.0), command=sent.append)
    rng = np.random.default_rng(0)
    for _ in range(80):
        drive_to(robot, (2.0, 1.0, 0.3), rng)
    ends = np.array(sent) + np.array([0.5, 0.25, 0.1])
    np.testing.assert_allclose(ends[:, 2], 0.86)
    off = ends[:, :2] - [2.0, 1.0]
    assert np.abs(off).max() <= 0.12
    assert off.min() < -0.11
    assert off.max() > 0.11


def test_what_was_not_tried_has_not_succeeded():
    one = ObjectTrial("Mug", 0.25)
    done = (one.servo.centered, one.depth.graspable, one.printed_depth.graspable, one.reach.closed, one.reach.lifted)
    assert not any((*done, one.printed_reach.closed, one.printed_reach.lifted))
    assert (one.printed_servo, one.approach, one.looks, one.cause) == (None, None, 0, "")
    assert np.isnan([*one.iou, one.depth.error, one.depth.surface_error, *one.depth.margins]).all()


CENTERED, NOT = ServoScore(True), ServoScore(False, "lost")


@pytest.fixture
def located(monkeypatch):
    """One object located by parts made by hand; what the robot was told is kept."""

    def run(found=True, scores=(CENTERED,), printed=None, looks=3):
        events = []
        robot = SimpleNamespace(
            joints=lambda: (np.array([float(len(events))]), 0.0), command=lambda dq: events.append(dq[0])
        )
        pending = list(scores)

        def center(camera, robot, segmenter, pinv, on_look=None):
            events.append(f"servo by {pinv}")
            return pending.pop(0), ServoRun(ServoEnd.CONVERGED, [None] * 4), 0.75

        def depth(camera, robot, result, segmenter, method, on_view):
            events.append(f"depth by {method}")
            result.depth = DepthScore(True)

        monkeypatch.setattr(object_trial, "ScoredCamera", lambda world, name: name)
        monkeypatch.setattr(object_trial, "ManipulatorRobot", lambda world, settle_frames: robot)
        monkeypatch.setattr(object_trial, "search_object", lambda *_: SimpleNamespace(found=found, looks=looks))
        monkeypatch.setattr(object_trial, "_center", center)
        monkeypatch.setattr(object_trial, "_estimate_depth", depth)
        return locate(None, "Mug", 0.25, None, "ours", printed_pinv=printed, method="vos-de"), events

    return run


def test_an_object_that_is_centered_gets_a_depth(located):
    result, events = located()
    assert events == ["servo by ours", "depth by vos-de"]
    assert result.servo is CENTERED
    assert result.printed_servo is None
    assert result.looks == 7
    assert result.iou[0] == 0.75
    assert result.depth.graspable
    assert (result.name, result.support, result.cause) == ("Mug", 0.25, "")


def test_an_object_that_is_not_centered_gets_none(located):
    result, events = located(scores=[NOT])
    assert events == ["servo by ours"]
    assert not result.depth.graspable
    assert result.cause == "lost"


def test_both_updates_begin_in_one_place(located):
    result, events = located(scores=[NOT, CENTERED], printed="printed")
    # It was at 0 and, by what was counted, at 1 when it was told to drive back.
    assert events == ["servo by printed", -1.0, "servo by ours", "depth by vos-de"]
    assert result.printed_servo is NOT
    assert result.servo is CENTERED


@pytest.mark.parametrize("printed", [None, "printed"])
def test_an_object_that_is_not_found(located, printed):
    result, events = located(found=False, printed=printed, looks=9)
    assert events == []
    assert result.cause == "not found in 9 looks"
    assert result.looks == 9
    assert (result.printed_servo is None) == (printed is None)


MASK = np.zeros((480, 640), bool)
MASK[200:280, 300:340] = True


@pytest.mark.parametrize(
    ("end", "offset", "good"),
    [(ServoEnd.CONVERGED, 24.0, True), (ServoEnd.CONVERGED, 26.0, False), (ServoEnd.LOST, 1.0, False)],
)
def test_a_servo_is_scored_by_the_true_centroid(monkeypatch, end, offset, good):
    made, told = {}, []

    class Servo:
        def __init__(self, camera, robot, segmenter, **options):
            made.update(options)

        def run(self, looks):
            made["looks"] = looks
            made["on_look"]("look", "image", MASK[:, ::-1])
            made["on_look"]("look", "image", MASK)
            return ServoRun(end, [])

    true = np.roll(MASK, 40, axis=0)
    camera = SimpleNamespace(world=None, object="Mug", overlap=lambda mask: intersection_over_union(mask, true))
    monkeypatch.setattr(object_trial, "MaskServo", Servo)
    monkeypatch.setattr(object_trial, "true_centroid", lambda *_: np.array([320.0 + offset / 2, 240.0 - offset]))
    score, run, iou = _center(camera, None, None, "pinv", lambda *seen: told.append(seen))
    assert score.centered == good
    assert run.end is end
    assert iou == pytest.approx(1 / 3)  # of the last look
    assert len(told) == 2
    assert (made["looks"], made["pinv"], made["gain"], made["target"]) == (20, "pinv", 0.8, (320.0, 240.0))
    assert made["joints"] == ("base_forward", "base_lateral")


FAR_OFF = TrueView(9.0, 9.0, 9.0, 0.1, 9.0)


def true_view(z):
    """From the lift at z [m], of an object whose outline is at 0.01 m."""
    return TrueView(z - 0.01, z, z - 0.02, 0.8, z + CAMERA_ABOVE_LIFT)


NEARING = (FAR_OFF, FAR_OFF, true_view(0.35))


def approached(monkeypatch, end, z_object, nearest, views=NEARING):
    camera_z = np.array([0.6, 0.45, 0.35, 0.4])
    areas = (30.0 / (camera_z - 0.01)) ** 2
    whole = np.array([True, True, True, False])
    approach = Approach(end, z_object, None, 0.1, camera_z, areas, whole, nearest)
    views = iter(views)
    made = {}

    class Depth:
        def __init__(self, camera, robot, segmenter, **options):
            made.update(options)

        def run(self):
            for k in range(3):
                made["on_view"](k, "image", MASK)
            return approach

    monkeypatch.setattr(object_trial, "DepthApproach", Depth)
    monkeypatch.setattr(object_trial, "fingers_in_view", lambda _: "fingers")
    camera = SimpleNamespace(world=None, true_view=lambda _: next(views))
    result = ObjectTrial("Mug", 0.0, CENTERED, iou=(0.9, float("nan")))
    seen = []
    _estimate_depth(camera, None, result, None, "robust", lambda *one: seen.append(one))
    assert len(seen) == 3
    assert (made["hidden"], made["joint"], made["method"]) == ("fingers", "arm_lift", "robust")
    return result


def test_a_depth_is_scored_on_the_nearest_view_by_both_methods(monkeypatch):
    result = approached(monkeypatch, ApproachEnd.NEAR, 0.0, 2)
    assert result.iou == (0.9, 0.8)
    assert result.depth.error == pytest.approx(0.35 / 0.34 - 1)
    assert result.printed_depth.error == pytest.approx(0.34 / 0.34 - 1, abs=1e-6)  # its fit is of whole views alone
    assert result.approach.z_object == 0.0


def test_the_nearest_view_need_not_be_the_last(monkeypatch):
    """Where the object leaves the image, as the last views of an approach may show."""
    result = approached(monkeypatch, ApproachEnd.LOST, 0.0, 1, (FAR_OFF, true_view(0.45), FAR_OFF))
    assert result.iou == (0.9, 0.8)
    assert result.depth.error == pytest.approx(0.45 / 0.44 - 1)
    assert result.printed_depth.error == pytest.approx(0.44 / 0.44 - 1, abs=1e-6)


def test_the_first_view_may_be_the_nearest(monkeypatch):
    result = approached(monkeypatch, ApproachEnd.LOST, 0.0, 0, (true_view(0.6), FAR_OFF, FAR_OFF))
    assert result.iou == (0.9, 0.8)
    assert result.depth.error == pytest.approx(0.6 / 0.59 - 1)


def test_an_approach_without_a_view_or_an_estimate_has_no_depth(monkeypatch):
    none = approached(monkeypatch, ApproachEnd.LOST, None, -1)
    assert not none.depth.graspable
    assert none.depth.cause.startswith("depth: ")
    assert none.printed_depth.cause == none.depth.cause
    views = approached(monkeypatch, ApproachEnd.LOST, None, 2)
    assert views.depth.cause.startswith("depth: ")
    assert np.isfinite(views.printed_depth.error)
    wrong = approached(monkeypatch, ApproachEnd.LOST, -3.0, 2)
    assert wrong.depth.cause.endswith(f"; approach ended: {ApproachEnd.LOST.value}")
    near = approached(monkeypatch, ApproachEnd.NEAR, -3.0, 2)
    assert "approach ended" not in near.depth.cause
    assert not near.depth.graspable
