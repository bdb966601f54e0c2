"""The experiments' loops with the simulator's ids in place of a segmenter, and what is made of their results."""

import argparse

import cv2
import numpy as np
import pytest

from dense_vs.depth.approach import ApproachEnd
from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspCheck, GraspOutcome, WristVerdict
from dense_vs.grasp.loop import GraspAttempt, GraspRun
from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs import (
    clutter,
    collaboration,
    learn,
    pick_place,
    segmentations,
    step_response,
    track,
    track_person,
    trial,
)
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
from dense_vs.sims.papers.vosvs.jacobian_learning import Episode, Learning, Update, learn_configuration
from dense_vs.sims.papers.vosvs.learning_figures import draw_learning, until_converged
from dense_vs.sims.papers.vosvs.object_pick import Pick, pick_and_place
from dense_vs.sims.papers.vosvs.object_trial import HEIGHT, ObjectTrial, locate
from dense_vs.sims.papers.vosvs.trial_rows import table_rows
from dense_vs.sims.papers.vosvs.trial_scores import DepthScore, ServoScore

ENDS = (ServoEnd.LOST, ServoEnd.CONVERGED, ServoEnd.CONVERGED)
HIGH, LOW = np.diag([-0.0018, 0.0018]), np.diag([-0.0004, 0.0004])


class Ids:
    """A perfect segmenter: for tests only."""

    def __init__(self, world, name, camera="grasp"):
        self.look = lambda: world.true_mask(camera, name)

    def segment(self, image):
        return self.look()


@pytest.fixture(scope="module")
def world():
    return MobileWorld(["Tuna", "Potted Meat"], seed=3, device="cpu")


@pytest.mark.slow
def test_object_is_found_picked_and_placed(world):
    world.store()
    world.place("Tuna", (1.0, 0.03, 0.125), 0.4)
    world.set_posture(above(0.92, 0.1, HEIGHT))
    pick = pick_and_place(world, "Tuna", 0.125, Ids(world, "Tuna"), HIGH, LOW, method="vos-de")
    assert pick.trial.servo.centered
    assert pick.trial.depth.graspable
    assert pick.trial.approach.end is ApproachEnd.NEAR
    assert abs(pick.trial.depth.error) < 0.02
    assert pick.placed, pick.cause
    assert pick.truly_held == [True]
    assert pick_place.checks_right(pick) == [True]


@pytest.mark.slow
def test_object_that_is_not_there(world):
    world.store()
    world.set_posture(above(1.0, 0.0, HEIGHT))
    before = world.joints()
    result = locate(world, "Potted Meat", 0.125, Ids(world, "Potted Meat"), HIGH)
    assert not result.servo.centered
    assert result.cause == "not found in 9 looks"
    # A bin stood in the way of some places, and turned the base, which a search moves straight alone.
    turned = np.array([name == "base_roll" for name in world.joint_names])
    np.testing.assert_allclose(world.joints()[~turned], before[~turned], atol=5e-3)
    np.testing.assert_allclose(world.joints()[turned], before[turned], atol=0.03)


@pytest.mark.slow
def test_h_base_is_learned_from_a_wrong_sign(world):
    one = next(config for config in CONFIGURATIONS if config.name == "base")
    result = learn_configuration(world, one, "Tuna", Ids(world, "Tuna"), np.random.default_rng(1), responses=1)
    assert result.converged
    assert result.history[0][0, 0] == 0.001
    assert result.pinv[0, 0] < 0 < result.pinv[1, 1]
    assert result.pinv[0, 1] == result.pinv[1, 0] == 0.0


@pytest.mark.slow
def test_object_is_centered_by_both_updates_from_one_place(world):
    """What was learned as printed goes first; the robot then begins where it began."""
    world.store()
    world.place("Tuna", (1.0, 0.03, 0.125), 0.4)
    world.set_posture(above(0.92, 0.1, HEIGHT))
    result = locate(world, "Tuna", 0.125, Ids(world, "Tuna"), HIGH, printed_pinv=np.zeros((2, 2)))
    assert result.printed_servo is not None
    assert not result.printed_servo.centered  # a J+ of zeros moves nothing
    assert result.servo.centered
    assert result.depth.graspable
    assert result.printed_depth.graspable
    assert abs(result.printed_depth.error) < 0.02
    assert result.iou == pytest.approx((1.0, 1.0))


def attempt(outcome):
    return GraspAttempt(ServoEnd.CONVERGED, WristVerdict.CLEAR, 0.0, False, 0.05, GraspCheck(outcome, 0.9), (1.0, 1.0))


def test_grasp_checks_are_counted_against_the_truth():
    outcomes = [GraspOutcome.JAMMED, GraspOutcome.MISSED, GraspOutcome.HELD]
    run = GraspRun([attempt(outcome) for outcome in outcomes], held=True)
    pick = Pick(ObjectTrial("Mug", 0.25), run, truly_held=[True, True])
    assert pick_place.checks_right(pick) == [False, True]
    rows = {row.name: row.ours for row in pick_place.table_rows({0: [pick]})}
    assert rows["in the bin, of 1 that fit the gripper"] == 0
    assert rows["grasp check right"] == 50.0


def test_trial_rows():
    yes, no = ServoScore(True), ServoScore(False, "lost")
    good = ObjectTrial("Mug", 0.25, yes, yes, DepthScore(True, -0.01, 0.02), DepthScore(False, 0.08), iou=(0.9, 0.8))
    bad = ObjectTrial("Dice", 0.125, yes, no, DepthScore(False, cause="depth"), DepthScore(True, -0.04))
    lost = ObjectTrial("Tuna", 0.0, no, no)
    found = table_rows({4: [good, bad], 7: [good, lost]}, {4: True, 7: False}, "robust")
    rows = {(row.name, row.seeds): row.ours for row in found}
    assert rows["VS of 2 (ClickBot 2023: 24), J+ feature by feature", (4,)] == 2
    assert rows["VS of 2 (ClickBot 2023: 24), J+ feature by feature", (7,)] == 1
    assert rows["VS of 2, J+ by (11) as printed", (4,)] == 1
    assert rows["J+ by (11) as printed converged (1) or not (0)", (4,)] == 1
    assert rows["J+ by (11) as printed converged (1) or not (0)", (7,)] == 0
    assert rows["DE of 2 (ClickBot 2023: 16), depth by robust", (4,)] == 1
    assert rows["DE of 2, depth by (20) as printed", (4,)] == 1
    assert rows["DE of 2, depth by (20) as printed", (7,)] == 0
    assert rows["depth error by robust, median, against the outline's depth", (4, 7)] == pytest.approx(1.0)
    assert rows["depth error by (20) as printed, median", (4, 7)] == pytest.approx(8.0)
    assert bad.cause == "depth"
    assert lost.cause == "lost"


@pytest.mark.parametrize(
    "experiment", [clutter, collaboration, learn, pick_place, segmentations, step_response, track, track_person, trial]
)
def test_other_devices_are_refused(experiment, tmp_path):
    parser = argparse.ArgumentParser()
    experiment.add_arguments(parser)
    arguments = parser.parse_args([])
    arguments.device, arguments.seeds, arguments.out, arguments.threads = "cuda:0", [0], tmp_path, 1
    with pytest.raises(DenseVSError, match="expected 'cpu'"):
        experiment.run(arguments)


def test_learn_rows():
    def learning(pinv, converged=True):
        pinv = np.array(pinv)
        return Learning(converged, 9 if converged else None, 20, 1, 3, pinv, pinv[None], [])

    one = next(config for config in CONFIGURATIONS if config.name == "arm both")
    pinv, true = [[-0.0004, 0], [-0.001, 0], [0, 0.003]], np.array([[-0.0008, 0], [-0.002, 0], [0, 0.004]])
    outcomes = {update: learning(pinv, update is not Update.ORIGINAL) for update in Update}
    found = learn.table_rows([learn.Learned(one, 4, outcomes, true, ("m", "rad", "rad"))], (4,))
    rows = {row.name: row.ours for row in found}
    units = {row.name: row.unit for row in found}
    assert units["arm both: darm_lift/ds_x, (11), denominator guarded"] == "m/px"
    assert units["arm both: darm_roll/ds_y, (11), denominator guarded"] == "rad/px"
    assert rows["converged of 7, (11), denominator guarded"] == 1
    assert rows["converged of 7, original Broyden"] == 0
    assert rows["steps taken back, (11) as printed"] == 3
    assert rows["arm both: part of the error in s_x that a step by (10) removes, (11) as printed"] == pytest.approx(1.0)
    assert rows["arm both: part of the error in s_y that a step by (10) removes, (11) as printed"] == pytest.approx(
        0.75
    )


def test_rows_of_several_seeds_are_medians():
    one = next(config for config in CONFIGURATIONS if config.name == "arm both")
    pinv, true = np.array([[-0.0004, 0], [-0.001, 0], [0, 0.003]]), np.array([[-0.0008, 0], [-0.002, 0], [0, 0.004]])

    def learned(seed, scale, updates, of_true):
        outcomes = {u: Learning(True, updates, 20, 1, 3, scale * pinv, scale * pinv[None], []) for u in Update}
        return learn.Learned(one, seed, outcomes, of_true * true, ("m", "rad", "rad"))

    ones = [learned(4, 1.0, 9, 1.0), learned(5, 4.0, None, 5.0), learned(6, 2.0, 30, 3.0), learned(7, 1.5, 11, 3.0)]
    rows = [(row.name, row.ours) for row in learn.table_rows(ones, (4, 5, 6, 7))]
    for element, index in (("darm_lift/ds_x", (0, 0)), ("dwrist_flex/ds_x", (1, 0)), ("darm_roll/ds_y", (2, 1))):
        place = [name for name, _ in rows].index(f"arm both: {element}, {Update.GUARDED}")
        assert [row[1] for row in rows[place : place + 3]] == pytest.approx(
            [1.75 * pinv[index], 1.75 * pinv[index], 3.0 * true[index]]
        )
    found = dict(rows)
    assert found[f"arm both: updates until s*, {Update.GUARDED}"] == 11  # of those that there were
    # 1, 0.8, 2 / 3 and a half of what is true, in y three quarters of that.
    parts = [
        found[f"{one.name}: part of the error in s_{x} that a step by (10) removes, {Update.GUARDED}"] for x in "xy"
    ]
    shares = np.array([1.0, 4 / 5, 2 / 3, 1 / 2])
    assert parts == pytest.approx([np.median(shares), np.median(0.75 * shares)])


def test_learning_is_drawn(tmp_path):
    """Ways in the image of every update up to the first that converged, and the views of H_base."""
    base = next(config for config in CONFIGURATIONS if config.name == "base")
    image, mask = np.full((480, 640, 3), 90, np.uint8), np.zeros((480, 640), bool)
    mask[200:240, 300:360] = True
    ways = [Episode(end, np.array([[10.0, 20.0], [300.0, 200.0]]), [], [image] * 2, [mask] * 2) for end in ENDS]
    pinv = np.array([[0.001, 0.0], [0.0, 0.001]])
    outcomes = {one: Learning(True, 9, 20, 1, 3, pinv, np.stack([pinv, 2 * pinv]), ways) for one in Update}
    draw_learning([learn.Learned(base, 4, outcomes, 2 * pinv, ("m", "m"))], tmp_path)
    assert until_converged(ways) == ways[:2]
    for name in ("learn.png", "learn_view.png"):
        drawn = cv2.imread(str(tmp_path / name))
        assert drawn is not None
        assert np.ptp(drawn) > 100
