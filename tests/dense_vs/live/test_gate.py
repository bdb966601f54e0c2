"""The gate: nothing passes unless motion is allowed, and what passes keeps the limits."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.live.gate import PRESS_SECONDS, GatedRobot, PageGate
from dense_vs.robot import JointGroup

LIMITS = np.array([[-1.0, 1.0], [-np.inf, np.inf]])
STEP = np.array([0.01, -0.02])
TURNING = JointGroup.choose(None, ("a", "b"), limits=LIMITS)
BOTH = JointGroup.choose(None, ("a", "b"), units=("rad", "m"))


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def passed(gate, step=STEP, positions=(0.0, 0.0), seconds=1 / 30, group=TURNING):
    return gate.passed(np.asarray(step), np.asarray(positions), group, seconds)


def test_it_is_closed_at_first_and_after_a_stop():
    gate = PageGate()
    assert not passed(gate).any()
    gate.allow()
    np.testing.assert_array_equal(passed(gate), STEP)
    assert gate.close("a key")
    assert not passed(gate).any()
    assert gate.reason == "a key"
    assert not gate.close("later")
    assert gate.reason == "a key"


def test_a_stop_ends_what_was_asked_for_before_it():
    gate = PageGate()
    asked = gate.stops
    gate.close("a key")  # closed already: somebody pressed Stop before the motion began
    with pytest.raises(DenseVSError, match="a stop came after"):
        gate.allow(asked)
    assert not gate.open
    assert not passed(gate).any()
    asked = gate.stops
    gate.close("learned", done=True)  # a motion that came to its end is no stop
    gate.allow(asked)
    assert gate.open


def test_a_fast_step_is_shortened_as_a_whole():
    gate = PageGate(0.3)
    gate.allow()
    np.testing.assert_allclose(passed(gate, [0.02, -0.04], seconds=1 / 30), [0.005, -0.01])
    np.testing.assert_allclose(passed(gate, [1.0, -2.0], seconds=5.0), [0.015, -0.03])  # a long pause allows no leap


def test_limits_let_a_joint_back_in_and_no_farther_out():
    gate = PageGate(1000.0)
    gate.allow()
    np.testing.assert_allclose(passed(gate, [0.3, 5.0], positions=(0.9, 0.0)), [0.1, 5.0])
    np.testing.assert_allclose(passed(gate, [0.3, 0.0], positions=(1.5, 0.0)), [0.0, 0.0])
    np.testing.assert_allclose(passed(gate, [-0.3, 0.0], positions=(1.5, 0.0)), [-0.3, 0.0])


def test_a_step_that_is_not_finite_does_not_pass():
    gate = PageGate()
    gate.allow()
    assert not passed(gate, [np.nan, 0.01]).any()


def test_a_dead_man_has_to_hold():
    clock = Clock()
    gate = PageGate(clock=clock)
    gate.dead_man = True
    gate.allow()
    assert not passed(gate).any()
    gate.press()
    assert passed(gate).any()
    clock.now += PRESS_SECONDS + 0.01
    assert not passed(gate).any()
    gate.press()
    gate.release()
    assert not passed(gate).any()


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, "1"])
def test_a_bad_speed_is_refused(speed):
    gate = PageGate()
    with pytest.raises(DenseVSError, match="max_speed"):
        gate.max_speed = speed
    assert gate.max_speed == 1.0


def test_a_stopped_robot_gets_zero_steps():
    class Robot:
        joint_names, joint_limits, got = ("a", "b"), None, None

        def joints(self):
            return np.zeros(2), 1.0

        def command(self, delta):
            self.got = delta

    gate, robot = PageGate(), Robot()
    gated = GatedRobot(robot, gate)
    gated.joints()
    gated.command(STEP)
    np.testing.assert_array_equal(robot.got, np.zeros(2))
    gate.allow()
    gated.command(STEP)
    np.testing.assert_array_equal(robot.got, STEP)


def test_the_defaults_by_hand():
    gate = PageGate()
    assert gate.max_speed == 1.0
    for seconds, step in ((0.02, 0.02), (0.1, 0.1), (0.2, 0.1)):
        np.testing.assert_array_equal(gate.largest_step(seconds, ("rad",)), [step])
    gate.allow()
    np.testing.assert_allclose(passed(gate, [0.02, -0.01], seconds=0.02), [0.02, -0.01])  # the border passes
    np.testing.assert_allclose(passed(gate, [0.04, -0.02], seconds=0.02), [0.02, -0.01])
    gate.max_speed = 0.5
    np.testing.assert_allclose(passed(gate, [0.04, -0.02], seconds=0.02), [0.01, -0.005])


def test_a_sliding_joint_goes_at_a_quarter_of_the_number():
    gate = PageGate()
    assert gate.sliding_speed == 0.25
    np.testing.assert_allclose(gate.largest_step(0.04, BOTH.units), [0.04, 0.01])
    gate.allow()
    np.testing.assert_allclose(passed(gate, [0.04, -0.01], seconds=0.04, group=BOTH), [0.04, -0.01])  # the border
    np.testing.assert_allclose(passed(gate, [0.04, -0.02], seconds=0.04, group=BOTH), [0.02, -0.01])  # as a whole
    np.testing.assert_allclose(passed(gate, [0.08, 0.0], seconds=0.04, group=BOTH), [0.04, 0.0])
    gate.max_speed = 0.4
    assert gate.sliding_speed == pytest.approx(0.1)
    np.testing.assert_allclose(passed(gate, [0.0, 0.02], seconds=0.04, group=BOTH), [0.0, 0.004])


@pytest.mark.parametrize(("after", "passes"), [(0.39, True), (0.4, False), (0.41, False)])
def test_a_press_counts_for_less_than_half_a_second(after, passes):
    clock = Clock()
    gate = PageGate(clock=clock)
    gate.dead_man = True
    gate.allow()
    clock.now = 5.0
    gate.press()
    clock.now += after
    assert gate.passing == passes
    assert gate.open
    gate.dead_man = False
    assert gate.passing


def test_a_press_opens_nothing():
    gate = PageGate()
    gate.dead_man = True
    gate.press()
    assert not gate.passing
    assert not gate.open
    assert gate.reason == "not started"
    gate.allow()
    assert gate.passing
    assert gate.reason == ""


def test_limits_on_both_sides():
    gate = PageGate(1000.0)
    gate.allow()
    np.testing.assert_allclose(passed(gate, [-0.3, -5.0], positions=(-0.9, 0.0)), [-0.1, -5.0])
    np.testing.assert_allclose(passed(gate, [-0.3, 0.0], positions=(-1.5, 0.0)), [0.0, 0.0])
    np.testing.assert_allclose(passed(gate, [0.3, 0.0], positions=(-1.5, 0.0)), [0.3, 0.0])


def test_a_gated_robot_is_limited_by_where_its_joints_were_read():
    class Robot:
        joint_names, joint_limits, got = ("a", "b"), LIMITS, None

        def joints(self):
            return np.array([0.995, 0.0]), 7.0

        def command(self, delta):
            self.got = delta

    gate, robot = PageGate(), Robot()
    gated = GatedRobot(robot, gate)
    assert gated.reading_time == -np.inf
    gate.allow()
    gated.joints()
    assert gated.reading_time == 7.0
    gated.command(np.array([0.02, 0.01]))
    np.testing.assert_allclose(robot.got, [0.005, 0.01])
    np.testing.assert_array_equal(gated.last_command, robot.got)
    gated.command(np.array([0.0, 0.1]))
    np.testing.assert_allclose(robot.got, [0.0, 1 / 30])  # a rad/s for a frame


def test_a_gated_robot_tells_sliding_joints_by_their_units():
    class Robot:
        joint_names, joint_limits, joint_units, got = ("a", "b"), None, ("m", "rad"), None

        def joints(self):
            return np.zeros(2), 7.0

        def command(self, delta):
            self.got = delta

    gate, robot = PageGate(), Robot()
    gated = GatedRobot(robot, gate)
    gated.frame_seconds = 0.02
    np.testing.assert_allclose(gated.largest_step, [0.005, 0.02])
    gate.allow()
    gated.joints()
    gated.command(np.array([0.01, 0.01]))
    np.testing.assert_allclose(robot.got, [0.005, 0.005])
