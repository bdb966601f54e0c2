"""The servo law, the pace of commands and the arrival, on cases made by hand on either side of every limit."""

import numpy as np
import pytest

from dense_vs import DenseVSError, VisualServo
from dense_vs.point_servo.command_pace import CommandPace
from dense_vs.point_servo.law import ServoOptions
from dense_vs.point_servo.reach import Arrival, Reach, ReachEnd

J = np.array([[100.0, 0.0], [0.0, 50.0]])  # px/rad


def test_the_defaults_are_those_documented():
    options = ServoOptions()
    assert (options.gain, options.damping, options.max_step, options.dither) == (0.2, 15.0, 0.03, 0.002)
    assert VisualServo(2).options == options


def test_a_step_by_hand():
    """Each joint moves one axis: s / (s^2 + d^2) of a fifth of the error."""
    step = VisualServo(2, dither=0.0)(J, [10.0, 20.0], [15.0, 14.0])
    np.testing.assert_allclose(step, [0.2 * 5 * 100 / (100**2 + 15**2), -0.2 * 6 * 50 / (50**2 + 15**2)], rtol=1e-12)


@pytest.mark.parametrize(("error", "step"), [(14.9, 0.0298), (15.1, 0.03), (400.0, 0.03)])
def test_the_longest_step(error, step):
    found = VisualServo(2, dither=0.0, damping=0.0)(J, [0.0, 0.0], [error, -error / 4])
    np.testing.assert_allclose(found, [step, -step / 2], rtol=1e-12)


def test_several_points_count_by_their_weights():
    """Two points that want opposite things of one joint."""
    servo = VisualServo(1, damping=0.0, dither=0.0, gain=1.0, max_step=9.0)
    jacobians = np.full((2, 2, 1), 0.0)
    jacobians[:, 0] = 100.0
    points, targets = np.zeros((2, 2)), np.array([[30.0, 0.0], [-10.0, 0.0]])
    assert servo.together(jacobians, points, targets) == pytest.approx(0.1)
    assert servo.together(jacobians, points, targets, [3.0, 1.0]) == pytest.approx(0.2)
    assert servo.together(jacobians, points, targets, [6.0, 2.0]) == pytest.approx(0.2)  # only ratios matter
    assert servo.together(jacobians, points, targets, [1.0, 3.0]) == pytest.approx(0.0)
    for weights in ([1.0, 0.0], [1.0, -1.0], [1.0]):
        with pytest.raises(DenseVSError, match="weights"):
            servo.together(jacobians, points, targets, weights)
    with pytest.raises(DenseVSError, match="at least one"):
        servo.together(np.zeros((0, 2, 1)), np.zeros((0, 2)), np.zeros((0, 2)))


def test_together_with_damping_the_largest_weight_is_one():
    servo = VisualServo(1, damping=100.0, dither=0.0, gain=1.0, max_step=9.0)
    jacobians = np.array([[[100.0], [0.0]], [[100.0], [0.0]]])
    step = servo.together(jacobians, np.zeros((2, 2)), [[30.0, 0.0], [-10.0, 0.0]], [4.0, 1.0])
    # (J^T W J + d^2)^-1 J^T W e with W = 1 and 1/4
    assert step == pytest.approx((100 * 30 - 25 * 10) / (100**2 + 50**2 + 100**2))


def test_limits_and_held_joints_of_several_points():
    servo = VisualServo(2, joint_limits=[[-1.0, 0.001], [-1.0, 1.0]], dither=0.0)
    jacobians, points, targets = np.stack([J, J]), np.zeros((2, 2)), np.full((2, 2), 5.0)
    step = servo.together(jacobians, points, targets, positions=[0.0, 0.0])
    assert step[0] == pytest.approx(0.001)
    assert 0.018 < step[1] < 0.02
    held = servo.together(jacobians, points, targets, positions=[0.0, 0.0], held=[False, True])
    assert held[1] == 0
    with pytest.raises(DenseVSError, match="positions are missing"):
        servo.together(jacobians, points, targets)


@pytest.mark.parametrize(("position", "low", "high"), [(0.99, -0.03, 0.01), (1.0, -0.03, 0.0), (-1.0, 0.0, 0.03)])
def test_room_at_a_limit(position, low, high):
    servo = VisualServo(2, joint_limits=[[-1.0, 1.0], [-np.inf, np.inf]], dither=0.0)
    for target, end in ((900.0, high), (-900.0, low)):
        step = servo(J, [0.0, 0.0], [target, 0.0], [position, 0.0])
        assert step[0] == pytest.approx(end, abs=1e-12)


def test_dither_moves_nothing_that_is_to_stay():
    servo = VisualServo(2, dither=0.01)
    assert servo(J, [1.0, 1.0], [1.0, 1.0]).tolist() == [0.0, 0.0]  # it is there
    steps = [servo(J, [1.0, 1.0], [9.0, 9.0], held=[True, False]) for _ in range(5)]
    assert all(step[0] == 0 and step[1] != 0 for step in steps)


def test_a_direction_that_the_joints_hardly_move_is_left_out():
    """Singular values of 1e-15 of the largest are rounding, and without damping a step by them would be endless."""
    nearly = np.array([[100.0, 0.0], [0.0, 1e-14]])
    servo = VisualServo(2, damping=0.0, dither=0.0, max_step=1.0)
    np.testing.assert_allclose(servo(nearly, [0.0, 0.0], [10.0, 10.0]), [0.02, 0.0], atol=1e-12)
    enough = np.array([[100.0, 0.0], [0.0, 1e-9]])
    assert abs(servo(enough, [0.0, 0.0], [10.0, 10.0])[1]) == pytest.approx(1.0)


def test_a_command_every_frame_or_every_period():
    assert all(CommandPace(None, 5.0).due(time) for time in (5.0, 5.0, 4.0))
    pace = CommandPace(0.1, 5.0)
    due = [pace.due(5.0 + k / 30) for k in range(10)]
    assert due == [True, False, False, True, False, False, True, False, False, True]


def test_a_period_that_is_no_multiple_of_a_frame_keeps_its_rate():
    pace = CommandPace(0.05, 0.0)
    due = [k for k in range(31) if pace.due(k / 30)]
    assert due == [0, 2, 3, 5, 6, 8, 9, 11, 12, 14, 15, 17, 18, 20, 21, 23, 24, 26, 27, 29, 30]


def test_after_a_pause_there_is_one_command_and_the_grid_goes_on():
    pace = CommandPace(0.1, 0.0)
    assert pace.due(0.0)
    assert pace.due(1.05)
    assert not pace.due(1.09)
    assert pace.due(1.1 - 1e-7)  # stamps are sums of rounded numbers
    assert not pace.due(1.15)
    for period in (0.0, -1.0, np.nan):
        with pytest.raises(DenseVSError, match="command_period"):
            CommandPace(period, 0.0)


def arrived(*frames, leave=None):
    arrival = Arrival(2.0, 3, leave)
    settled = []
    for distance in frames:
        arrival.observe(abs(distance), blind=distance < 0)
        settled.append(arrival.settled)
    return settled


def test_a_point_has_arrived_that_stays():
    assert arrived(2.0, 2.0, 2.0) == [False, False, True]  # the border is within
    assert arrived(2.0, 2.0, 2.01, 1.0, 1.0, 1.0) == [False, False, False, False, False, True]
    assert arrived(1.0, 1.0, -1.0, 1.0, 1.0, 1.0) == [False] * 5 + [True]  # a blind frame does not count


def test_a_point_that_has_arrived_may_sway_a_little():
    assert arrived(1.0, 1.0, 1.0, 3.0, 3.1, 1.0, leave=3.0) == [False, False, True, True, False, False]
    assert arrived(3.0, 3.0, 3.0, leave=3.0) == [False] * 3  # it has to come in first
    assert arrived(1.0, 1.0, 1.0, 2.1) == [False, False, True, False]


@pytest.mark.parametrize(("distance", "close"), [(0.6, True), (0.61, False)])
def test_a_point_is_close_within_a_third_of_the_tolerance(distance, close):
    arrival = Arrival(2.0, 3)
    assert not arrival.close
    arrival.observe(0.0)
    arrival.observe(distance)
    assert arrival.close is close


@pytest.mark.parametrize("end", list(ReachEnd))
def test_a_reach_says_how_it_ended(end):
    reach = Reach((1.0, 2.0), 10, 0.5, end)
    assert reach.reached == (end.value == "reached")
    assert reach.lost == (end.value == "lost")


@pytest.mark.parametrize("held", ["no", [True], True, [1, 0], [0.0, 1.0], [True, None], [[True, True]]])
def test_held_joints_are_told_by_a_flag_each(held):
    servo, both = VisualServo(2, dither=0.0), [[9.0, 9.0]]
    for call in (lambda: servo(J, [1.0, 1.0], [9.0, 9.0], held=held),
                 lambda: servo.together(J[None], np.ones((1, 2)), np.array(both), held=held)):  # fmt: skip
        with pytest.raises(DenseVSError, match=r"^held is .*; expected True or False for each of 2$"):
            call()
