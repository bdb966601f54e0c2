"""What becomes of picks, step responses and tracks: hand-made runs that fail, stand at the border, and pass."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.grasp import GraspCheck, GraspOutcome, WristVerdict
from dense_vs.grasp.loop import GraspAttempt, GraspRun
from dense_vs.mask_servo.loop import ServoEnd, ServoRun
from dense_vs.sims.papers.vosvs import object_pick, step_response, track, tracking
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial


def attempt(outcome, *, contact=False, opening=0.02):
    check = GraspCheck(outcome, 0.9)
    return GraspAttempt(ServoEnd.CONVERGED, WristVerdict.CLEAR, 0.0, contact, opening, check, (9.0, 8.0))


class Heights:
    """A world that knows only how high an object reaches, and where it lies once it has been let go and has fallen."""

    def __init__(self, heights, center):
        self._heights, self._center = iter(heights), np.array(center)
        self.done = []  # what was asked of world and gripper

    def highest_point(self, _):
        return next(self._heights)

    def object_center(self, _):
        return self._center if self.done[-2:] == ["open", ("wait", 20)] else np.array(IN_HAND)

    def wait(self, frames):
        self.done.append(("wait", frames))


@pytest.fixture
def picked(monkeypatch):
    """A pick whose grasp loop makes the given attempts in a world of given heights."""

    def run(heights, outcomes, center):
        class Loop:
            def __init__(self, *_, on_attempt, **__):
                self._on_attempt = on_attempt

            def run(self, z_object):
                assert z_object == 0.3
                done = [one if isinstance(one, GraspAttempt) else attempt(one) for one in outcomes]
                for one in done:
                    self._on_attempt(one)
                return GraspRun(done, held=done[-1].check.outcome is GraspOutcome.HELD)

        trial = ObjectTrial("Mug", 0.0)
        trial.approach = SimpleNamespace(z_object=0.3)
        world = Heights(heights, center)
        tool = SimpleNamespace(open=lambda: world.done.append("open"))
        for name, value in (
            ("locate", lambda *_, **__: trial),
            ("GraspLoop", Loop),
            ("ManipulatorGripper", lambda _: tool),
            ("ManipulatorRobot", lambda _: None),
            ("ManipulatorCamera", lambda *_: None),
            ("hand_geometry", lambda _: None),
            ("carry_to_bin", lambda *_: world.done.append("carry")),
        ):
            monkeypatch.setattr(object_pick, name, value)
        return object_pick.pick_and_place(world, "Mug", 0.0, None, np.eye(2), np.eye(2))

    return run


IN_HAND = (*object_pick.DROP, 0.5)  # above the bin
IN_BIN, BESIDE = (*object_pick.BIN, 0.05), (object_pick.BIN[0] + 1.0, object_pick.BIN[1], 0.05)


def test_an_object_is_held_where_it_rose_with_the_gripper(picked):
    outcomes = [GraspOutcome.MISSED, GraspOutcome.HELD]
    pick = picked([0.10, 0.12, 0.30, 0.5], outcomes, IN_BIN)
    assert pick.truly_held == [False, True]
    assert pick.placed
    assert pick.cause == ""


def test_a_check_that_believes_in_an_empty_gripper_is_told_apart(picked):
    pick = picked([0.10, 0.10, 0.2], [GraspOutcome.HELD], BESIDE)
    assert pick.truly_held == [False]
    assert not pick.placed
    assert pick.cause == "slipped out on the way"  # at 0.2 m it was below the bin's rim


def test_what_was_carried_and_fell_beside_the_bin(picked):
    pick = picked([0.10, 0.30, object_pick.BIN_RIM + 0.01], [GraspOutcome.HELD], BESIDE)
    assert pick.truly_held == [True]
    assert (pick.placed, pick.cause) == (False, "fell beside the bin")


def test_nothing_is_placed_where_the_last_attempt_missed(picked):
    pick = picked([0.10, 0.10, 0.10], [GraspOutcome.MISSED, GraspOutcome.MISSED], IN_BIN)
    assert pick.truly_held == [False, False]
    assert not pick.placed
    assert pick.cause.startswith("2 attempts, the last: servo converged")


def test_the_last_of_three_attempts_is_told_of(picked):
    """In words, its opening in millimeters."""
    attempts = [
        attempt(GraspOutcome.LOST),
        attempt(GraspOutcome.UNKNOWN, opening=0.05),
        attempt(GraspOutcome.MISSED, contact=True, opening=0.031),
    ]
    pick = picked([0.1] * 4, attempts, IN_BIN)
    assert pick.cause == "3 attempts, the last: servo converged, wrist clear, contact, opening 31 mm, missed"
    assert picked([0.1] * 4, attempts[:2], IN_BIN).cause.endswith("wrist clear, no contact, opening 50 mm, unknown")


@pytest.mark.parametrize(
    ("centroid", "offset"), [((320.0, 240.0), 0.0), ((323.0, 239.0), 3.0), ((319.0, 250.0), 10.0), ((300.0, 241.0), 20)]
)
def test_true_error_of_a_step_response_is_the_larger_component(centroid, offset):
    assert step_response.true_offset(np.array(centroid), (320.0, 240.0)) == offset
    assert np.isnan(step_response.true_offset(np.full(2, np.nan), (320.0, 240.0)))


def response(config, end, error, looks):
    return step_response.Response(config, "Mug", 3, ServoRun(end, [None] * looks), np.zeros((1, 1, 3)), error)


def test_rows_of_step_responses():
    ones = [
        response("base", ServoEnd.CONVERGED, 2.0, 4),
        response("base", ServoEnd.CONVERGED, 8.0, 10),
        response("base", ServoEnd.EXHAUSTED, 90.0, 20),
        response("arm wrist", ServoEnd.LOST, 50.0, 3),
    ]
    rows = {row.name: row for row in step_response.table_rows(ones, (3, 5))}
    assert rows["base: centered of 3"].ours == 2
    assert rows["base: centered of 3"].paper is None
    assert rows["base: looks until centered, median"].ours == 7
    assert rows["base: true error then, median"].ours == 5.0
    assert (rows["arm wrist: centered of 1"].ours, rows["arm wrist: centered of 1"].paper) == (0, 8)
    assert np.isnan(rows["arm wrist: true error then, median"].ours)


def test_rows_of_tracks():
    target, nowhere = np.array([320.0, 240.0]), (np.nan, np.nan)
    tracks = []
    for config in track.SPEED:
        one = np.array([(321.0, 240.0), (320.0, 250.0), (290.0, 240.0), nowhere])
        tracks += [
            tracking.Track(config, 0, one, target, 2, 1.5, []),
            tracking.Track(config, 1, one[:2], target, 1, 0.5, []),
        ]
    rows = {row.name: row.ours for row in tracking.table_rows(tracks, "object", (0, 1))}
    for config in track.SPEED:
        assert rows[f"{config}: looks with the object in view"] == pytest.approx(100 * 5 / 6)
        assert rows[f"{config}: true error, median"] == 10.0
        assert rows[f"{config}: true error, 90th percentile"] == pytest.approx(22.0)
        assert rows[f"{config}: times lost"] == 3
        assert rows[f"{config}: the object's way"] == 1.0
