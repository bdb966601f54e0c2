"""Readings that cannot be, stamps that are none of this clock's, and joints that do not follow."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.health import FaultKind, JointWatch

FRAME = 1 / 30
MOST = np.array([0.1, 0.1])


class Robot:
    """Two joints that follow their commands a frame later, and the watch on them."""

    def __init__(self, rng=None):
        self.watch = JointWatch(("a", "b"), MOST)
        self.q, self.time, self.rng = np.zeros(2), 5.0, rng or np.random.default_rng(0)
        self.follows = np.ones(2)
        assert self.read() == []

    def read(self, off=(0.0, 0.0), late=0.0):
        return self.watch.judge(self.q + off, self.time - late, self.time)

    def step(self, **read):
        delta = self.rng.normal(0, 0.02, 2)
        self.watch.commanded(np.where(self.watch.stuck, 0.0, delta))
        self.q, self.time = self.q + delta * self.follows, self.time + FRAME
        return self.read(**read)


def kinds(faults):
    return [fault.kind for fault in faults]


def test_a_robot_that_follows_is_sound():
    robot = Robot()
    for _ in range(300):
        assert robot.step() == []
        np.testing.assert_array_equal(robot.watch.positions, robot.q)


@pytest.mark.parametrize("off", [0.5, -0.5, 3.0, np.nan, np.inf])
def test_a_glitch_is_not_believed(off):
    robot = Robot()
    for _ in range(10):
        robot.step()
    believed = robot.watch.positions.copy()
    (fault,) = robot.step(off=(0.0, off))
    assert fault.kind is FaultKind.READING
    assert fault.stops
    np.testing.assert_array_equal(robot.watch.positions, believed)
    for _ in range(30):
        assert robot.step() == []


def test_a_jump_that_stays_is_never_believed_until_the_watch_begins_anew():
    robot = Robot()
    for _ in range(10):
        robot.step()
    for _ in range(200):
        robot.time += FRAME  # nothing is commanded while a reading is not believed
        assert kinds(robot.read(off=(0.7, 0.0))) == [FaultKind.READING]
    robot.watch.restart()
    for _ in range(10):
        assert robot.step(off=(0.7, 0.0)) == []


def test_what_is_commanded_while_a_reading_is_doubted_allows_no_jump():
    robot = Robot()
    robot.time += FRAME
    assert kinds(robot.read(off=(3.0, 0.0))) == [FaultKind.READING]
    for _ in range(10):
        robot.watch.commanded(np.array([0.1, 0.0]))
    robot.time += FRAME
    assert kinds(robot.read(off=(0.8, 0.0))) == [FaultKind.READING]
    assert robot.read() == []


@pytest.mark.parametrize("late", [0.3, -0.5, 1e9, -1e9, np.nan, np.inf])
def test_a_stamp_of_another_clock(late):
    robot = Robot()
    for _ in range(10):
        robot.step(late=0.02)
    for _ in range(5):
        assert kinds(robot.step(late=late)) == [FaultKind.CLOCK]
    for _ in range(40):
        faults = robot.step(late=0.02)
    assert faults == []


@pytest.mark.parametrize("late", [1.5, -1.7e9, np.nan])
def test_a_first_stamp_of_another_clock_is_refused(late):
    watch = JointWatch(("a", "b"), MOST)
    with pytest.raises(DenseVSError, match="expected one clock for joints and camera"):
        watch.judge(np.zeros(2), 10.0 - late, 10.0)
    assert watch.positions is None


def test_a_joint_that_does_not_follow_is_named_and_tried_again():
    robot = Robot()
    for _ in range(10):
        robot.step()
    robot.follows[1] = 0.0
    seen = [robot.step() for _ in range(40)]
    held = [any(fault.holds for fault in faults) for faults in seen]
    assert np.argmax(held) < 10  # nothing is learned from it long before it is named
    named = [any("left out" in str(fault) for fault in faults) for faults in seen]
    assert np.argmax(named) <= 26
    assert "stuck joint: b stays at" in str(next(f for faults in seen for f in faults if "left out" in str(f)))
    assert robot.watch.stuck.tolist() == [False, True]
    robot.follows[1] = 1.0
    for _ in range(5):
        robot.step()
    assert not robot.watch.stuck.any()
    for _ in range(30):
        faults = robot.step()
    assert faults == []


def test_a_reading_at_the_border_of_what_can_be_is_believed():
    watch = JointWatch(("a", "b"), MOST)
    assert watch.judge(np.zeros(2), 5.0, 5.0) == []
    (fault,) = watch.judge(np.array([3.0, 0.0]), 5.0 + FRAME, 5.0 + FRAME)
    most = float(str(fault).split("at most ")[1].split(" can")[0])
    assert watch.judge(np.array([most, 0.0]), 5.0 + FRAME, 5.0 + FRAME) == []
    np.testing.assert_array_equal(watch.positions, [most, 0.0])
