"""DE done: with true masks and told depths, by real contact; and its score on cases made by hand."""

import numpy as np
import pytest

from dense_vs.mask_servo.loop import ServoEnd
from dense_vs.sims.mobile_manipulator.postures import CAMERA_ABOVE_LIFT, above
from dense_vs.sims.mobile_manipulator.world import OPENING, MobileWorld
from dense_vs.sims.papers.vosvs.depth_reach import reach_depth
from dense_vs.sims.papers.vosvs.trial_scores import LIFTED, score_reach

NAME, SUPPORT = "Potted Meat", 0.125
PINV = np.array([[-0.0004, 0.0], [0.0, 0.0004]])  # of H_base grasp, about


@pytest.fixture(scope="module")
def world():
    return MobileWorld([NAME], seed=1, noise=0.0, threads=1)


class TrueMasks:
    def __init__(self, world, seen=True):
        self._world, self._seen = world, seen

    def segment(self, image):
        return self._seen & self._world.true_mask("grasp", NAME)


def reach(world, below_top, seen=True):
    """Tell the robot that the object is so far below its top [m]."""
    world.store()
    world.set_posture(above(1.0, 0.0, 0.45))
    world.place(NAME, (1.0, 0.0, SUPPORT), 0.3)
    z_object = SUPPORT + world.objects[NAME].height - below_top - CAMERA_ABOVE_LIFT
    return reach_depth(world, NAME, TrueMasks(world, seen), PINV, z_object)


@pytest.mark.parametrize(
    ("below_top", "closed", "lifted", "cause"),
    [
        (0.02, True, True, ""),
        (-0.02, False, False, "the object was not between the fingers"),
        (0.09, False, True, "the fingers touched the room"),  # into the support, on the object nevertheless
    ],
)
def test_a_depth_is_done(world, below_top, closed, lifted, cause):
    score = reach(world, below_top)
    assert (score.closed, score.lifted, score.cause) == (closed, lifted, cause)
    assert world.before_frame is None
    assert world.opening() > 0.9 * OPENING
    assert world.object_position(NAME)[2] == pytest.approx(SUPPORT, abs=0.02)  # put down again


def test_an_object_that_is_lost_under_the_gripper(world):
    score = reach(world, 0.02, seen=False)
    assert not score.closed
    assert not score.lifted
    assert score.cause == "did not close, lost under the gripper: servo lost"


@pytest.mark.parametrize(
    ("judged", "risen", "closed", "lifted", "cause"),
    [
        ((True, False, False), 0.15, True, True, ""),
        ((True, False, False), LIFTED + 1e-6, True, True, ""),
        ((True, False, False), LIFTED, True, False, ""),
        ((True, False, False), -0.1, True, False, ""),
        ((False, False, False), 0.15, False, True, "the object was not between the fingers"),
        ((True, True, False), 0.15, False, True, "the fingers touched the room"),
        ((True, False, True), 0.15, False, True, "the palm touched the object"),
        (
            (False, True, True),
            0.0,
            False,
            False,
            "the fingers touched the room, the palm touched the object, the object was not between the fingers",
        ),
    ],
)
def test_the_score_of_a_reach(judged, risen, closed, lifted, cause):
    score = score_reach(judged, risen, ServoEnd.CONVERGED)
    assert (score.closed, score.lifted, score.cause) == (closed, lifted, cause)


def test_a_gripper_that_never_closed():
    assert score_reach(None, 1.0, ServoEnd.LOST).cause == "did not close, lost under the gripper: servo lost"
    jammed = score_reach(None, 1.0, None)
    assert jammed.cause == "did not close, the gripper did not open"
    assert not jammed.closed
    assert not jammed.lifted
