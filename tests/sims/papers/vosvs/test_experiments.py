"""The experiments' loops with the simulator's ids in place of a segmenter, and what is made of their results."""

import argparse

import numpy as np
import pytest

from dense_vs.depth.approach import ApproachEnd
from dense_vs.errors import DenseVSError
from dense_vs.grasp import GraspCheck, GraspOutcome, WristVerdict
from dense_vs.grasp.loop import GraspAttempt, GraspRun
from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.postures import above
from dense_vs.sims.mobile_manipulator.world import MobileWorld
from dense_vs.sims.papers.vosvs import learn, pick_place, step_response, track, trial
from dense_vs.sims.papers.vosvs.configurations import CONFIGURATIONS
from dense_vs.sims.papers.vosvs.learning import Learning
from dense_vs.sims.papers.vosvs.learning import learn as learn_configuration
from dense_vs.sims.papers.vosvs.picking import Pick, pick_and_place
from dense_vs.sims.papers.vosvs.trials import HEIGHT, ObjectTrial, locate

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


def test_object_is_found_picked_and_placed(world):
    world.store()
    world.place("Tuna", (1.0, 0.03, 0.125), 0.4)
    world.set_posture(above(0.92, 0.1, HEIGHT))
    pick = pick_and_place(world, "Tuna", 0.125, Ids(world, "Tuna"), HIGH, LOW, method="vos-de")
    assert pick.trial.servo
    assert pick.trial.depth
    assert pick.trial.approach.end is ApproachEnd.NEAR
    assert abs(pick.trial.depth_error) < 0.02
    assert pick.placed, pick.cause
    assert pick.truly_held == [True]
    assert pick_place.checks_right(pick) == [True]


def test_object_that_is_not_there(world):
    world.store()
    world.set_posture(above(1.0, 0.0, HEIGHT))
    before = world.joints()
    result = locate(world, "Potted Meat", 0.125, Ids(world, "Potted Meat"), HIGH)
    assert not result.servo
    assert result.cause == "not found in 9 looks"
    np.testing.assert_allclose(world.joints(), before, atol=5e-3)  # though a bin stood in the way of some places


def test_h_base_is_learnt_from_a_wrong_sign(world):
    one = next(config for config in CONFIGURATIONS if config.name == "base")
    result = learn_configuration(world, one, "Tuna", Ids(world, "Tuna"), np.random.default_rng(1), responses=1)
    assert result.converged
    assert result.history[0][0, 0] == 0.001
    assert result.pinv[0, 0] < 0 < result.pinv[1, 1]
    assert result.pinv[0, 1] == result.pinv[1, 0] == 0.0


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
    good = ObjectTrial("Mug", 0.25, servo=True, depth=True, depth_error=-0.01, surface_error=0.02)
    bad = ObjectTrial("Dice", 0.125, servo=True, cause="depth")
    rows = {(row.name, row.seeds): row for row in trial.table_rows({4: [good, bad], 7: [good]})}
    assert rows["VS of 24 (ClickBot 2023: 24)", (4,)].ours == 2
    assert rows["DE of 24 (ClickBot 2023: 16)", (7,)].ours == 1
    assert rows["depth error, median, against the outline's depth", (4, 7)].ours == pytest.approx(1.0)


@pytest.mark.parametrize("experiment", [learn, pick_place, step_response, track, trial])
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
    outcomes = {"hadamard": learning(pinv), "featurewise": learning(pinv), "original": learning(pinv, False)}
    rows = {row.name: row.ours for row in learn.table_rows([learn.Learnt(one, 4, outcomes, true)], (4,))}
    assert rows["converged of 7, (11)"] == 1
    assert rows["converged of 7, original Broyden"] == 0
    assert rows["steps taken back, (11)"] == 3
    assert rows["arm both: part of the error in s_x that a step (10) removes, (11)"] == pytest.approx(1.0)
    assert rows["arm both: part of the error in s_y that a step (10) removes, (11)"] == pytest.approx(0.75)
