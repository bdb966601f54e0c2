"""Tables of trials, picks and learning from results made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.grasp import GraspCheck, GraspOutcome, WristVerdict
from dense_vs.grasp.loop import GraspAttempt, GraspRun
from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.papers.vosvs import learn, pick_place
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
from dense_vs.sims.papers.vosvs.finite_percentile import finite_percentile
from dense_vs.sims.papers.vosvs.jacobian_learning import Update
from dense_vs.sims.papers.vosvs.object_pick import Pick
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial
from dense_vs.sims.papers.vosvs.trial_rows import COLUMNS, line, table_rows
from dense_vs.sims.papers.vosvs.trial_scores import DepthScore, ReachScore, ServoScore


def result(centered, printed, graspable, by_areas, error, iou=0.9):
    return ObjectTrial(
        "Mug",
        0.0,
        ServoScore(centered),
        None if printed is None else ServoScore(printed),
        DepthScore(graspable, error, 2 * error),
        DepthScore(by_areas, 3 * error, error),
        ReachScore(graspable and centered, centered),
        ReachScore(by_areas, False),
        iou=(0.1, iou),
    )


def test_successes_of_a_trial_are_counted_by_method():
    ones = [
        result(True, False, True, False, -0.01, 0.9),
        result(True, None, False, False, 0.03, 0.7),
        result(False, True, True, True, float("nan"), float("nan")),
    ]
    rows = table_rows({5: ones, 6: ones[:1]}, {5: True, 6: False}, "robust")
    by = {(row.name, row.seeds): row.ours for row in rows}
    assert by["VS of 3 (ClickBot 2023: 24), J+ feature by feature", (5,)] == 2
    assert by["VS of 3, J+ by (11) as printed", (5,)] == 1
    assert by["DE of 3 (ClickBot 2023: 16), depth by robust", (5,)] == 2
    assert by["DE of 3, depth by (20) as printed", (5,)] == 1
    assert by["DE done: closed on it, of 3, depth by robust", (5,)] == 1
    assert by["DE done: closed on it, of 3, depth by (20) as printed", (5,)] == 1
    assert by["DE done: lifted it, of 3, depth by robust", (5,)] == 2
    assert by["DE done: lifted it, of 3, depth by (20) as printed", (5,)] == 0
    assert by["J+ by (11) as printed converged (1) or not (0)", (5,)] == 1
    assert by["J+ by (11) as printed converged (1) or not (0)", (6,)] == 0
    assert by["VS of 1, J+ by (11) as printed", (6,)] == 0
    assert by["depth error by robust, median, against the outline's depth", (5, 6)] == pytest.approx(1.0)
    assert by["depth error by robust, 90th percentile", (5, 6)] == pytest.approx(2.6)
    assert by["depth error by (20) as printed, 90th percentile", (5, 6)] == pytest.approx(7.8)
    assert by["mask IoU at the nearest view, median", (5, 6)] == 0.9
    assert by["mask IoU at the nearest view, 10th percentile", (5, 6)] == pytest.approx(0.74)
    assert by["mask IoU when centered, median", (5, 6)] == 0.1
    assert {row.paper for row in rows} == {None}  # the paper's are of all 24


def test_the_paper_s_successes_stand_beside_those_of_all_objects():
    rows = table_rows({1: [result(True, True, True, True, 0.01)] * 24}, {1: True}, "robust")
    papers = {row.name: row.paper for row in rows if row.paper is not None}
    assert papers == {
        "VS of 24 (ClickBot 2023: 24), J+ feature by feature": 20,
        "VS of 24, J+ by (11) as printed": 20,
        "DE of 24 (ClickBot 2023: 16), depth by robust": 10,
        "DE of 24, depth by (20) as printed": 10,
        "DE done: closed on it, of 24, depth by robust": 10,
        "DE done: closed on it, of 24, depth by (20) as printed": 10,
    }
    assert {row.ours for row in rows if row.name in papers} == {24}


def test_lines_of_the_trials():
    one = ObjectTrial(
        "Mug",
        0.25,
        ServoScore(True),
        ServoScore(False),
        DepthScore(True, -0.012),
        DepthScore(False, 0.3),
        ReachScore(False, True, "the fingers touched the room"),
        ReachScore(True),
        iou=(0.9, 0.75),
    )
    cells = ["2", "Mug", "0.25", "X", "", "X", "", "", "X", "-1.2 +30.0", "0.90 0.75"]
    assert line(2, one) == [*cells, "done: the fingers touched the room"]
    assert len(line(2, one)) == len(COLUMNS)
    one.printed_servo = None
    assert line(2, one)[4] == ""
    one.printed_servo = ServoScore(True)
    assert line(2, one)[4] == "X"


def pick(placed, truly, outcome, error, areas=(100.0, 100.0)):
    attempt = GraspAttempt(ServoEnd.CONVERGED, WristVerdict.CLEAR, 0.0, False, 0.05, GraspCheck(outcome, 1.0), areas)
    one = Pick(ObjectTrial("Mug", 0.0, depth=DepthScore(True, error)), GraspRun([attempt], held=True), [truly], placed)
    return one


def test_picks_and_checks_are_counted():
    held, missed = GraspOutcome.HELD, GraspOutcome.MISSED
    picks = {
        1: [pick(True, True, held, 0.02), pick(False, True, missed, -0.04, (100.0, 1.0))],
        2: [pick(True, True, held, 0.01), pick(True, False, missed, 0.3)],
    }
    rows = pick_place.table_rows(picks)
    assert [(row.name, row.ours, row.seeds) for row in rows[:2]] == [
        ("in the bin, of 2 that fit the gripper", 1, (1,)),
        ("in the bin, of 2 that fit the gripper", 2, (2,)),
    ]
    found = {row.name: row.ours for row in rows[2:]}
    assert found["grasp check right"] == 75.0
    assert found["(23) alone right"] == 50.0  # the areas of the second say missed, those of the fourth held
    assert found["grasp checks"] == 4
    assert found["depth error, median"] == pytest.approx(3.0)


def test_percentiles_leave_out_what_is_missing():
    assert finite_percentile([1.0, np.nan, 3.0, np.inf]) == 2.0
    assert finite_percentile([0.0, 10.0, np.nan], 90) == 9.0
    assert np.isnan(finite_percentile([np.nan]))


def learned(seed, one, *, converged, updates, scale):
    """All updates ended alike, with J+ ``scale`` times the true one."""
    true = 0.002 * one.coupling
    outcome = SimpleNamespace(
        converged=converged, updates=updates, restarts=2, retreats=3, looks=40, pinv=scale * true, true=[true]
    )
    return learn.Learned(one, seed, dict.fromkeys(Update, outcome), true, ("rad",) * len(one.joints))


def test_learned_elements_stand_beside_the_papers():
    ones = [learned(1, one, converged=one.name != "head", updates=4, scale=0.5) for one in CONFIGURATIONS]
    ones += [learned(2, one, converged=True, updates=None, scale=1.0) for one in CONFIGURATIONS]
    ones += [learned(3, one, converged=True, updates=10, scale=1.0) for one in CONFIGURATIONS]
    rows = learn.table_rows(ones, (1, 2, 3))
    by = {(row.name, row.seeds): row for row in rows}
    for update in Update:
        assert by[f"converged of 7, {update}", (1,)].ours == 6
        assert by[f"converged of 7, {update}", (2,)].ours == 7
        assert by[f"times put back, {update}", (1,)].ours == 14
        assert by[f"steps taken back, {update}", (1,)].ours == 21
        assert by[f"looks until s*, all seven, {update}", (2,)].ours == 280
        assert by[f"converged of 7, {update}", (1,)].paper == (
            7 if update in (Update.PRINTED, Update.GUARDED) else None
        )
    both = (1, 2, 3)
    assert by[f"base: updates until s*, {Update.GUARDED}", both].ours == 7
    assert by[f"base: updates until s*, {Update.GUARDED}", both].paper == 14
    assert by[f"head: updates until s*, {Update.GUARDED}", both].paper is None
    part = by[f"head: part of the error in s_x that a step by (10) removes, {Update.GUARDED}", both]
    assert part.ours == pytest.approx(1.0)
    element = by[f"head: dhead_tilt/ds_y, {Update.GUARDED}", both]
    assert (element.ours, element.paper, element.unit) == (pytest.approx(0.002), 0.00183, "rad/px")
