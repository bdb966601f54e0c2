"""The last gate on cases made by hand: what is sent, and from when on nothing is."""

import numpy as np
import pytest

from dense_vs.robot import CommandGate, JointGroup

LIMITS = np.array([[-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]])


class Robot:
    joint_names, joint_limits = ("a", "b", "c"), LIMITS

    def __init__(self):
        self.sent = []

    def joints(self):
        return np.zeros(3), 0.0

    def command(self, delta):
        self.sent.append(np.array(delta))


def gate_of(names=("a", "b", "c"), max_step=0.1, **options):
    robot = Robot()
    return CommandGate(robot, JointGroup.of_robot(robot, list(names)), max_step=max_step, **options), robot


def test_a_long_step_is_shortened_as_a_whole():
    gate, robot = gate_of(max_step=[0.1, 0.1, 0.01])
    np.testing.assert_allclose(gate.send([0.1, -0.05, 0.01], np.zeros(3)), [0.1, -0.05, 0.01])
    np.testing.assert_allclose(gate.send([0.4, -0.2, 0.0], np.zeros(3)), [0.1, -0.05, 0.0])
    np.testing.assert_allclose(gate.send([0.1, 0.1, 0.02], np.zeros(3)), [0.05, 0.05, 0.01])
    np.testing.assert_allclose(robot.sent[1], [0.1, -0.05, 0.0])
    assert not gate.stopped


def test_joints_outside_of_the_group_get_zero():
    gate, robot = gate_of(["c", "a"])
    np.testing.assert_allclose(gate.send([0.01, 0.02], np.zeros(2)), [0.01, 0.02])
    np.testing.assert_allclose(robot.sent, [[0.02, 0.0, 0.01]])


@pytest.mark.parametrize(
    ("stamps", "sent"),
    [
        ({"image_time": 1.0, "now": 1.5}, True),
        ({"image_time": 1.0, "now": 1.501}, False),
        ({"reading_time": 1.0, "now": 1.5}, True),
        ({"reading_time": 1.0, "now": 1.501}, False),
        ({"image_time": 2.0, "reading_time": 1.5}, True),
        ({"image_time": 2.0, "reading_time": 1.499}, False),
        ({"image_time": 1.5, "reading_time": 2.0}, True),
        ({"image_time": 1.499, "reading_time": 2.0}, False),
        ({"image_time": 2.0, "now": 1.0}, True),  # now is the newest that is known
        ({"now": np.inf}, False),
        ({"reading_time": np.nan}, False),
        ({"stop": "dark"}, False),
        ({}, True),
    ],
)
def test_what_is_older_than_half_a_second_moves_nothing(stamps, sent):
    gate, _ = gate_of()
    step = gate.send([0.05, 0.0, 0.0], np.zeros(3), **stamps)
    assert step.any() == sent
    assert bool(gate.stopped) != sent


def test_the_age_can_be_told():
    gate, _ = gate_of(max_age=0.1)
    assert gate.send([0.05, 0, 0], np.zeros(3), image_time=1.0, now=1.09).any()
    assert not gate.send([0.05, 0, 0], np.zeros(3), image_time=2.0, now=2.11).any()
    assert gate.stopped == "the image is 0.110 s old"


def test_an_older_image_than_the_last_motion_s_moves_nothing():
    gate, _ = gate_of()
    step = [0.05, 0.0, 0.0]
    assert gate.send(step, np.zeros(3), image_time=1.0).any()
    assert not gate.send(step, np.zeros(3), image_time=0.9).any()
    assert gate.send(step, np.zeros(3)).any()  # a step that needs no image
    assert not gate.send(step, np.zeros(3), image_time=1.1, stop="why").any()
    assert gate.send(step, np.zeros(3), image_time=1.1).any()  # what was stopped has not used it up
    assert not gate.stopped


def test_steps_add_up_to_a_limit_even_where_the_readings_lag():
    gate, _ = gate_of()
    sent = [gate.send([0.1, 0.0, 0.0], np.array([0.75, 0.0, 0.0]))[0] for _ in range(5)]
    # The target runs ahead of the reading and is drawn back to it by a tenth of the way.
    target, expected = 0.75, []
    for _ in range(5):
        expected.append(min(0.1, max(1.0 - max(target, 0.75), 0.0)))
        target += expected[-1] + 0.1 * (0.75 - target)
    np.testing.assert_allclose(sent, expected)
    assert sent[2] < 0.1
    gate.restart()
    assert gate.send([0.1, 0.0, 0.0], np.array([0.75, 0.0, 0.0]))[0] == 0.1


def test_the_other_limit_is_that_of_what_was_sent_too():
    gate, _ = gate_of()
    sent = [gate.send([-0.1, 0.0, 0.0], np.array([-0.85, 0.0, 0.0]))[0] for _ in range(3)]
    assert sent[0] == pytest.approx(-0.1)
    assert sent[1] == pytest.approx(-0.05)
    assert sent[2] == pytest.approx(-0.01)  # drawn back by a tenth of 0.1


def test_a_joint_outside_its_limits_may_come_back():
    gate, _ = gate_of()
    q = np.array([1.2, -1.2, 0.0])
    assert gate.send([0.1, -0.1, 0.05], q).tolist() == [0.0, 0.0, 0.05]
    gate.restart()
    np.testing.assert_allclose(gate.send([-0.1, 0.1, 0.05], q), [-0.1, 0.1, 0.05])


@pytest.mark.parametrize("most", [1e-99, 1e300])
def test_bounds_at_the_edge_of_numbers(most):
    gate, _ = gate_of(max_step=most)
    step = gate.send([1e308, -1e308, 0.0], np.zeros(3))
    assert np.isfinite(step).all()
    assert np.abs(step).max() <= most
    assert step[0] == -step[1] > 0
