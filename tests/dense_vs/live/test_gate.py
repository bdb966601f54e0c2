"""The gate: nothing passes unless motion is allowed, and what passes keeps the limits."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.live.gate import PRESS_SECONDS, GatedRobot, PageGate

LIMITS = np.array([[-1.0, 1.0], [-np.inf, np.inf]])
STEP = np.array([0.01, -0.02])


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def passed(gate, step=STEP, positions=(0.0, 0.0), seconds=1 / 30):
    return gate.passed(np.asarray(step), np.asarray(positions), LIMITS, seconds)


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
