"""How a robot moves while its J+ is wrong: what is bounded, taken back, and moved alone."""

from typing import Any

import numpy as np
import pytest

from dense_vs.mask_servo.trust_region import FARTHER, FIRST_STEP, LEAST_STEP, TrustRegion, View
from dense_vs.segmentation import assess_mask

SHAPE = (240, 320)
H = np.eye(2)


def square(x, y, side=40):
    mask = np.zeros(SHAPE, dtype=bool)
    mask[max(y, 0) : y + side, max(x, 0) : x + side] = True
    return mask


def region(coupling: Any = H, **options: float) -> TrustRegion:
    options = {"tolerance": 3.0, "min_motion": 0.01, "max_step": 0.3, "image_step": 60.0, **options}
    return TrustRegion(coupling, **options)


def look(trust: TrustRegion, mask: np.ndarray, positions: Any, before: Any = None) -> View:
    view = trust.judge(assess_mask(mask), np.asarray(positions), before)
    if view in (View.WHOLE, View.ANEW):
        error = np.array(assess_mask(mask).centroid) - [160.0, 120.0]
        trust.advance(view, np.asarray(positions), error, assess_mask(mask))
    return view


def test_views():
    trust = region()
    assert look(trust, np.zeros(SHAPE, dtype=bool), [0.0, 0.0]) is View.PART
    assert look(trust, square(-10, 50), [0.0, 0.0]) is View.PART
    assert look(trust, square(50, 50), [0.0, 0.0]) is View.ANEW
    assert look(trust, square(60, 50), [0.01, 0.0]) is View.WHOLE
    assert look(trust, square(60, 50, 30), [0.01, 0.0]) is View.PART  # something hides a part
    assert look(trust, square(60, 50, 50), [0.01, 0.0]) is View.ANEW
    trust.command(np.array([0.02, 0.02]))
    assert look(trust, square(60, 50, 50), [0.03, 0.011], np.array([0.01, 0.01])) is View.BLOCKED


def test_step_follows_how_far_the_object_moves():
    trust = region()
    assert trust.step == FIRST_STEP
    look(trust, square(100, 100), [0.0, 0.0])
    look(trust, square(130, 100), [0.02, 0.0])
    assert trust.step == pytest.approx(1.5 * FIRST_STEP)
    look(trust, square(210, 100), [0.05, 0.0])
    assert trust.step == pytest.approx(1.5 * FIRST_STEP * 60 / 80)
    look(trust, square(209, 100), [0.051, 0.0])  # short for another reason than the bound
    assert trust.step == pytest.approx(1.5 * FIRST_STEP * 60 / 80)


def test_lost_step_is_taken_back_and_made_the_other_way():
    trust = region()
    look(trust, square(5, 150), [0.0, 0.0])
    cut = square(-15, 140)  # x, wrong, was driven over the border; y was not
    assert look(trust, cut, [0.02, 0.02]) is View.PART
    error = np.array(assess_mask(cut).centroid) - [160.0, 120.0]
    back = trust.retreat(np.array([0.02, 0.02]), error, assess_mask(cut), SHAPE)
    assert back is not None
    assert back[1] == pytest.approx(-0.02)
    assert -0.02 * (1 + FARTHER) <= back[0] < -0.04
    np.testing.assert_array_equal(trust.active(np.ones((2, 2))), [[1, 1], [0, 0]])
    assert trust.step == pytest.approx(0.5 * FIRST_STEP)
    look(trust, square(65, 150), [-0.06, 0.0])  # nothing of its own doing, so x still moves alone
    np.testing.assert_array_equal(trust.active(np.ones((2, 2))), [[1, 1], [0, 0]])
    look(trust, square(75, 150), [-0.065, 0.0])
    np.testing.assert_array_equal(trust.active(np.ones((2, 2))), np.ones((2, 2)))


def test_what_is_in_the_way_of_one_feature_lets_the_other_go_first():
    trust = region()
    look(trust, square(20, 60), [0.0, 0.0])
    nothing, empty = np.full(2, np.nan), np.zeros(SHAPE, dtype=bool)
    back = trust.retreat(np.array([0.001, 0.02]), nothing, assess_mask(empty), SHAPE)
    assert back is not None
    np.testing.assert_allclose(back, [-0.001, -0.02])
    np.testing.assert_array_equal(trust.active(np.ones((2, 2))), [[1, 1], [0, 0]])
    trust.retreat(np.zeros(2), nothing, assess_mask(empty), SHAPE)
    assert trust.retreat(np.zeros(2), nothing, assess_mask(empty), SHAPE) is None
    assert trust.retreats == 2
    assert trust.step >= LEAST_STEP


def test_without_coupling_the_whole_step_is_turned_round():
    trust = region(None)
    look(trust, square(5, 100), [0.0, 0.0])
    cut = square(-15, 110)
    error = np.array(assess_mask(cut).centroid) - [160.0, 120.0]
    back = trust.retreat(np.array([0.02, 0.02]), error, assess_mask(cut), SHAPE)
    assert back is not None
    # The centroid went by (-12.5, 10) px, so 3.7 times as far makes 60 px, for which there is room.
    assert back[0] == back[1] == pytest.approx(-0.02 * (1 + 60 / np.hypot(12.5, 10)))
    np.testing.assert_array_equal(trust.active(np.ones((2, 2))), np.ones((2, 2)))


def test_small_commands_are_made_large_enough_to_learn_from():
    trust = region()
    np.testing.assert_allclose(trust.enough(np.array([1e-5, 0.02]), np.array([50.0, 5.0])), [0.0125, 0.0])
    np.testing.assert_allclose(trust.enough(np.array([0.02, 1e-5]), np.array([50.0, 5.0])), [0.02, 1e-5])


@pytest.mark.parametrize("command", [0.02, LEAST_STEP])
def test_a_stopped_joint_goes_the_other_way_alone(command):
    trust = region()
    look(trust, square(60, 50), [0.0, 0.0])
    trust.command(np.array([command, 0.002]))
    assert look(trust, square(60, 50), [0.0, 0.002], np.zeros(2)) is View.BLOCKED
    error = np.array(assess_mask(square(60, 50)).centroid) - [160.0, 120.0]
    step = trust.retreat(np.array([0.0, 0.002]), error, assess_mask(square(60, 50)), SHAPE)
    assert step is not None
    assert step[0] < -0.02  # more than min_motion, so that it is learned from
    assert step[1] == pytest.approx(-0.002)  # back
    np.testing.assert_array_equal(trust.active(np.ones((2, 2))), [[1, 1], [0, 0]])


def test_joints_of_both_features_that_grew_go_back_and_beyond():
    trust = region()
    look(trust, square(60, 60), [0.0, 0.0])
    hidden = square(50, 50, 20)
    error = np.array(assess_mask(hidden).centroid) - [160.0, 120.0]
    back = trust.retreat(np.array([0.02, 0.03]), error, assess_mask(hidden), SHAPE)
    assert back is not None
    assert back[0] < -0.03
    assert back[1] == pytest.approx(1.5 * back[0])
