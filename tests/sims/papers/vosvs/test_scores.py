"""Every score of the trials on hand-made cases that fail, stand at the border, and pass."""

from importlib import resources

import mujoco
import numpy as np
import pytest

from dense_vs.depth.approach import Approach, ApproachEnd
from dense_vs.grasp import GraspCheck, GraspOutcome, WristVerdict
from dense_vs.grasp.loop import GraspAttempt, GraspRun
from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.postures import CAMERA_ABOVE_LIFT, FINGERTIP
from dense_vs.sims.papers.vosvs.object_pick import BIN, BIN_FLOOR, BIN_HALF, BIN_RIM, Pick, came_along, lies_in_bin
from dense_vs.sims.papers.vosvs.object_trial import ObjectTrial, printed_depth_score
from dense_vs.sims.papers.vosvs.pick_place import checks_right
from dense_vs.sims.papers.vosvs.trial_scores import TrueView, intersection_over_union, score_depth, score_servo

NEAREST = 0.35  # m, of the lift at the nearest view
TOP, SUPPORT = 0.05, 0.02  # m, of an object 3 cm high


@pytest.mark.parametrize(
    ("end", "offset", "centered"),
    [
        (ServoEnd.CONVERGED, 3.0, True),
        (ServoEnd.CONVERGED, 24.9, True),
        (ServoEnd.CONVERGED, 25.0, False),
        (ServoEnd.CONVERGED, 80.0, False),  # it servoed to something else
        (ServoEnd.CONVERGED, float("nan"), False),
        (ServoEnd.LOST, 3.0, False),
        (ServoEnd.EXHAUSTED, 3.0, False),
    ],
)
def test_centered_only_if_it_says_so_and_it_is_true(end, offset, centered):
    score = score_servo(end, offset, 0.9)
    assert score.centered == centered
    assert bool(score.cause) == (not centered)


def view(distance=NEAREST + CAMERA_ABOVE_LIFT - TOP):
    """An object whose top and outline are at one depth."""
    return TrueView(distance, distance + 0.01, distance, 0.9, NEAREST + CAMERA_ABOVE_LIFT)


def tips_at(height):
    """The estimate on the lift's axis that brings the fingertips to a height."""
    return height + FINGERTIP - CAMERA_ABOVE_LIFT


@pytest.mark.parametrize(
    ("height", "graspable", "cause"),
    [
        (TOP - 0.001, True, ""),
        (0.5 * (TOP + SUPPORT), True, ""),
        (SUPPORT + 0.001, True, ""),
        (TOP + 0.001, False, "closes above the object by 1 mm"),
        (TOP + 0.1, False, "closes above the object by 100 mm"),
        (SUPPORT - 0.001, False, "hit the support by 1 mm"),
        (SUPPORT - 0.1, False, "hit the support by 100 mm"),
    ],
)
def test_depth_is_good_where_the_fingers_can_close(height, graspable, cause):
    score = score_depth(tips_at(height), NEAREST, view(), SUPPORT)
    assert score.graspable == graspable
    assert cause in score.cause
    np.testing.assert_allclose(score.margins, [height - SUPPORT, TOP - height], atol=1e-12)


def test_camera_inside_a_tall_object():
    tall = TrueView(0.31, 0.31, 0.31, 0.9, NEAREST + CAMERA_ABOVE_LIFT)  # its top is at 0.2 m
    assert score_depth(tips_at(0.1), NEAREST, tall, SUPPORT).graspable
    score = score_depth(tips_at(0.025), NEAREST, tall, SUPPORT)
    assert min(score.margins) > 0
    assert not score.graspable
    assert "camera hits the object by 1 mm" in score.cause


def test_depth_errors_are_relative_to_the_truth():
    true = TrueView(0.4, 0.5, 0.38, 0.9, NEAREST + CAMERA_ABOVE_LIFT)
    score = score_depth(NEAREST - 0.42, NEAREST, true, SUPPORT)
    assert score.error == pytest.approx(0.05)
    assert score.surface_error == pytest.approx(-0.16)


def approach(areas, camera_z):
    areas, camera_z = np.array(areas, dtype=float), np.array(camera_z)
    whole = areas > 0
    return Approach(ApproachEnd.NEAR, None, None, np.inf, camera_z, areas, whole, int(np.argmin(camera_z)))


def test_printed_depth_is_the_fit_of_areas():
    z_object = tips_at(0.035)
    camera_z = np.linspace(0.7, NEAREST, 8)
    score = printed_depth_score(approach((30.0 / (camera_z - z_object)) ** 2, camera_z), view(), SUPPORT)
    assert score.graspable
    assert score.error == pytest.approx((NEAREST - z_object) / view().outline - 1)


def test_printed_depth_that_cannot_be_told():
    score = printed_depth_score(approach([100, 100, 100], [0.7, 0.5, NEAREST]), view(), SUPPORT)
    assert not score.graspable
    assert np.isnan(score.error)
    assert "100 px in all 3 views" in score.cause


@pytest.mark.parametrize(("after", "held"), [(0.05, False), (0.1, False), (0.101, True), (0.3, True), (0.0, False)])
def test_object_in_the_gripper_rises(after, held):
    assert came_along(0.05, after) is held


@pytest.mark.parametrize(
    ("offset", "height", "inside"),
    [
        ((0.0, 0.0), 0.05, True),
        ((BIN_HALF[0] - 0.001, -BIN_HALF[1] + 0.001), 0.05, True),
        ((BIN_HALF[0] + 0.001, 0.0), 0.05, False),
        ((0.0, -BIN_HALF[1] - 0.001), 0.05, False),
        ((0.0, 0.0), 0.011, False),  # below the bin's floor: beside it
        ((0.0, 0.0), BIN_RIM, False),  # still in the gripper
        ((0.0, 0.0), BIN_RIM - 0.001, True),
    ],
)
def test_object_in_the_bin(offset, height, inside):
    assert lies_in_bin(np.array([BIN[0] + offset[0], BIN[1] + offset[1], height])) is inside


def test_the_bin_is_the_one_of_the_model():
    """Its bounds are the middles of its walls, its floor the top of its bottom."""
    text = resources.files("dense_vs.sims").joinpath("models", "mobile_manipulator.xml").read_text(encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    np.testing.assert_allclose(model.body("drop_bin").pos[:2], BIN)
    assert lies_in_bin(np.array([*model.body("drop_bin").pos[:2], 0.05]))
    np.testing.assert_allclose([model.geom("drop_bin_back").pos[0], model.geom("drop_bin_left").pos[1]], BIN_HALF)
    bottom = model.geom("drop_bin_bottom")
    assert bottom.pos[2] + bottom.size[2] == pytest.approx(BIN_FLOOR)


def attempt(outcome, areas=(100.0, 100.0), opening=0.05):
    check = GraspCheck(outcome, 1.0)
    return GraspAttempt(ServoEnd.CONVERGED, WristVerdict.CLEAR, 0.0, False, opening, check, areas)


def test_checks_are_right_where_they_say_what_is_true():
    attempts = [
        attempt(GraspOutcome.JAMMED),
        attempt(GraspOutcome.LOST, (0.0, 0.0), float("nan")),  # never closed: not a check
        attempt(GraspOutcome.MISSED),
        attempt(GraspOutcome.HELD, (100.0, 50.0)),
        attempt(GraspOutcome.HELD, (100.0, 51.0)),
    ]
    pick = Pick(ObjectTrial("Mug", 0.0), GraspRun(attempts, held=True), truly_held=[False, True, True, False])
    assert checks_right(pick) == [False, True, False]
    assert checks_right(pick, areas_alone=True) == [True, False, False]
    assert checks_right(Pick(ObjectTrial("Mug", 0.0))) == []


def test_overlap_of_masks():
    mask = np.zeros((10, 20), bool)
    mask[:, :10] = True
    assert intersection_over_union(mask, np.roll(mask, 5, axis=1)) == pytest.approx(1 / 3)
    assert intersection_over_union(mask, ~mask) == 0.0
    assert intersection_over_union(None, mask) == 0.0
