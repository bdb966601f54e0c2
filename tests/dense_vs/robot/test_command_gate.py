"""Nothing that could do harm passes the last gate, whatever is asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dense_vs import DenseVSError
from dense_vs.robot import CommandGate, JointGroup

NAMES = ("a", "b", "c")
LIMITS = np.array([[-1.0, 1.0], [0.2, 0.3], [-np.inf, np.inf]])
MOST = np.array([0.1, 0.01, 0.5])


class Recording:
    joint_names, joint_limits = NAMES, LIMITS

    def __init__(self, q):
        self.q, self.sent = np.array(q), []

    def joints(self):
        return self.q.copy(), 0.0

    def command(self, delta):
        self.sent.append(np.array(delta))
        self.q = self.q + delta


def gate_of(robot, **options):
    return CommandGate(robot, JointGroup.of_robot(robot), max_step=MOST, **options)


number = st.floats(allow_nan=False, allow_infinity=False, width=64)
command = st.lists(number, min_size=3, max_size=3)
inside = st.tuples(st.floats(-1, 1), st.floats(0.2, 0.3), number.filter(lambda x: abs(x) < 1e6))


@given(start=inside, commands=st.lists(command, min_size=1, max_size=8), wrong=st.lists(st.floats(-5, 5), max_size=8))
@settings(max_examples=200, deadline=None)
def test_a_robot_that_follows_stays_inside_and_slow(start, commands, wrong):
    robot = Recording(start)
    gate = gate_of(robot)
    for number, delta in enumerate(commands):
        # The readings may be anything: a single one off, or all.
        gate.send(delta, robot.q + (wrong[number] if number < len(wrong) and number else 0.0))
    sent = np.array(robot.sent)
    assert np.isfinite(sent).all()
    assert (np.abs(sent) <= MOST).all()


@given(start=inside, commands=st.lists(command, min_size=1, max_size=30))
@settings(max_examples=200, deadline=None)
def test_limits_are_kept(start, commands):
    robot = Recording(start)
    gate = gate_of(robot)
    for delta in commands:
        gate.send(delta, robot.q)
        assert (robot.q >= LIMITS[:, 0] - 1e-9).all()
        assert (robot.q <= LIMITS[:, 1] + 1e-9).all()


@given(start=st.lists(st.floats(-50, 50), min_size=3, max_size=3), commands=st.lists(command, min_size=1, max_size=8))
@settings(max_examples=200, deadline=None)
def test_a_joint_outside_its_limits_goes_no_further_out(start, commands):
    robot = Recording(start)
    gate = gate_of(robot)
    for delta in commands:
        before = np.maximum(np.maximum(LIMITS[:, 0] - robot.q, robot.q - LIMITS[:, 1]), 0)
        gate.send(delta, robot.q)
        after = np.maximum(np.maximum(LIMITS[:, 0] - robot.q, robot.q - LIMITS[:, 1]), 0)
        assert (after <= before + 1e-9).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused_and_nothing_sent(bad):
    robot = Recording([0.0, 0.25, 0.0])
    gate = gate_of(robot)
    for delta, q in (([bad, 0, 0], robot.q), ([0.0, 0, 0], [0.0, bad, 0])):
        with pytest.raises(DenseVSError, match=r"(command|joint positions) is .*expected finite"):
            gate.send(delta, q)
    for delta in (np.zeros(2), np.zeros((3, 1)), "up", None, [1j, 0, 0]):
        with pytest.raises(DenseVSError, match="command"):
            gate.send(delta, robot.q)
    assert not robot.sent


@pytest.mark.parametrize(
    ("stamps", "reason"),
    [
        ({"image_time": 1.0, "now": 1.6}, "the image is 0.600 s old"),
        ({"image_time": 1.0, "reading_time": 2.0}, "the image is 1.000 s old"),
        ({"image_time": 2.0, "reading_time": 1.0}, "the joint reading is 1.000 s old"),
        ({"image_time": np.nan}, "a time stamp is not finite"),
        ({"image_time": 1.0, "stop": "dark"}, "dark"),
    ],
)
def test_old_images_and_readings_move_nothing(stamps, reason):
    robot = Recording([0.0, 0.25, 0.0])
    gate = gate_of(robot)
    np.testing.assert_array_equal(gate.send([0.05, 0, 0], robot.q, **stamps), 0)
    assert gate.stopped == reason
    np.testing.assert_array_equal(robot.sent, np.zeros((1, 3)))  # the robot is told to stay


def test_an_image_moves_the_robot_once():
    robot = Recording([0.0, 0.25, 0.0])
    gate = gate_of(robot)
    gate.send(np.zeros(3), robot.q, image_time=1.0)
    assert gate.send([0.05, 0, 0], robot.q, image_time=1.0).any()
    assert not gate.send([0.05, 0, 0], robot.q, image_time=1.0).any()
    assert gate.stopped == "the image of 1.000 s was acted on before"
    assert gate.send([0.05, 0, 0], robot.q, image_time=1.1).any()
    gate.restart()
    assert gate.send([0.05, 0, 0], robot.q, image_time=0.5).any()


def test_refuses_bounds_that_are_none():
    robot = Recording([0.0, 0.25, 0.0])
    for bound in (0.0, -1.0, np.inf, np.nan, [0.1, 0.1]):
        with pytest.raises(DenseVSError, match="max_step is"):
            CommandGate(robot, JointGroup.of_robot(robot), max_step=bound)
    with pytest.raises(DenseVSError, match="max_age is"):
        gate_of(robot, max_age=0.0)
