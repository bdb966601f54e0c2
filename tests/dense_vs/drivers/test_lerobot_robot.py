"""The LeRobot driver on a simulated SO-101."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from fake_so101 import NAMES, FakeSO101, FakeWithoutBus

from dense_vs import Robot
from dense_vs.drivers import lerobot_robot
from dense_vs.drivers.lerobot_robot import LEAD, MOST_DROPPED, LeRobotRobot
from dense_vs.errors import DenseVSError

COUNT = 2 * np.pi / 4096


@pytest.fixture
def arm():
    return FakeSO101()


@pytest.fixture
def robot(arm):
    return LeRobotRobot(arm)


def test_it_is_a_robot_whose_joints_count_from_the_start(robot):
    assert isinstance(robot, Robot)
    assert robot.joint_names == NAMES[:5]
    positions, first = robot.joints()
    np.testing.assert_array_equal(positions, np.zeros(5))
    assert robot.joints()[1] > first


def test_a_command_moves_in_counts(robot, arm):
    robot.command(np.array([0.1, 0, 0, 0, -0.01]))
    assert arm.bus.goal["shoulder_pan"] == 2048 + round(0.1 / COUNT)
    assert arm.bus.goal["gripper"] == 2048
    for _ in range(12):
        positions, _ = robot.joints()
    np.testing.assert_allclose(positions, [0.1, 0, 0, 0, -0.01], atol=COUNT)


def test_small_steps_add_up(robot, arm):
    for _ in range(100):
        robot.command(np.full(5, 0.2 * COUNT))
        robot.joints()
    assert abs(arm.bus.goal["elbow_flex"] - (2048 + 20)) <= 1


def test_a_goal_neither_runs_ahead_nor_past_the_ends_of_the_counts(robot, arm):
    for _ in range(100):
        robot.command(np.array([0.05, 0, 0, 0, -0.05]))  # no reading in between: the arm does not follow
    assert arm.bus.goal["shoulder_pan"] <= 2048 + LEAD / COUNT + 1
    assert arm.bus.goal["wrist_roll"] == 0
    np.testing.assert_allclose(robot.joint_limits[4], [-30 * COUNT, 1.0])
    assert (robot.joint_limits[:, 0] < robot.joint_limits[:, 1]).all()


def test_a_zero_step_writes_nothing_and_hold_writes_where_it_is(robot, arm):
    robot.command(np.zeros(5))
    assert not arm.bus.writes
    robot.command(np.full(5, 0.1))
    robot.joints()
    robot.hold()
    assert arm.bus.writes[-1] == {name: arm.bus.position[name] for name in robot.joint_names}


def test_a_dropped_reading_keeps_its_old_stamp_and_many_are_an_error(robot, arm):
    before = robot.joints()
    arm.bus.dropped = 2
    for _ in range(2):
        positions, time = robot.joints()
        assert time == before[1]
        np.testing.assert_array_equal(positions, before[0])
    assert robot.joints()[1] > before[1]
    arm.bus.dropped = MOST_DROPPED + 1
    for _ in range(MOST_DROPPED):
        robot.joints()
    with pytest.raises(DenseVSError, match="dropped 6 readings"):
        robot.joints()


def test_a_robot_without_a_bus_is_used_in_degrees():
    other = FakeWithoutBus()
    robot = LeRobotRobot(other)
    assert robot.joint_names == ("neck", "head")
    robot.command(np.radians([2.0, -3.0]))
    np.testing.assert_allclose([other.at["neck.pos"], other.at["head.pos"]], [12.0, -23.0])
    np.testing.assert_allclose(robot.joints()[0], np.radians([2.0, -3.0]))


def test_what_cannot_be_used_is_refused(arm):
    with pytest.raises(DenseVSError, match="expected some of shoulder_pan"):
        LeRobotRobot(arm, joints=["elbow"])
    with pytest.raises(DenseVSError, match="delta"):
        LeRobotRobot(arm).command(np.array([np.nan, 0, 0, 0, 0]))
    arm.disconnect()
    with pytest.raises(DenseVSError, match="not connected"):
        LeRobotRobot(arm)


def test_the_watchdog_holds_by_the_bus_alone(arm, monkeypatch):
    arm.bus.goal["elbow_flex"] = 3000
    monkeypatch.setattr(lerobot_robot, "made", lambda kind, port: arm)
    lerobot_robot.hold("so101_follower", "/dev/null")
    assert arm.bus.goal == arm.bus.position
    assert arm.bus.connected is False


def test_the_motors_of_a_robot_keep_holding_when_it_is_left(monkeypatch):
    """LeRobot lets go of them unless told otherwise, and an arm that lets go falls."""
    configured = {}

    def configuration(**options):
        configured.update(options)
        return options

    robots, utils = ModuleType("lerobot.robots"), ModuleType("lerobot.robots.utils")
    robots.__path__ = []
    robots.RobotConfig = SimpleNamespace(get_known_choices=lambda: {"so101_follower": configuration})
    utils.make_robot_from_config = lambda config: ("robot of", config)
    for module in (ModuleType("lerobot"), robots, utils):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    assert lerobot_robot.made("so101_follower", "/dev/x") == ("robot of", configured)
    assert configured == {"port": "/dev/x", "disable_torque_on_disconnect": False}
    with pytest.raises(DenseVSError, match="robot is 'so100'; expected one of so101_follower"):
        lerobot_robot.made("so100", "/dev/x")


def test_the_module_needs_no_lerobot():
    with pytest.raises(ImportError, match="lerobot"):
        LeRobotRobot.connect("so101_follower", "/dev/null")
