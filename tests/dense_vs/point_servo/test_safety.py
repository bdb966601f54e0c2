"""What would endanger the robot: readings, stamps and images that are wrong, each noticed and none acted on."""

import numpy as np
import pytest
from planar_robot import PlanarRobot, PlaneCamera

from dense_vs import DenseVSError, ServoLoop
from dense_vs.health import FaultKind

MOST = 0.1  # rad a command; babbling and servo stay well below


def make(scene, limit=0.5, **options):
    robot = PlanarRobot(limit)
    camera = PlaneCamera(robot, scene)
    # Its joints shift a plane: no body whose joints turn.
    return robot, camera, ServoLoop(camera, robot, **{"device": "cpu", "seed": 2, "body_model": False} | options)


def largest(robot):
    return np.abs(robot.sent).max()


def test_one_reading_far_off_moves_nothing_far(scene):
    robot, _, loop = make(scene, limit=1.0)
    loop.babble(0.5)
    begin = len(robot.sent)
    robot.reads = lambda q, time: (q + (3.0 if len(robot.sent) == begin + 2 else 0.0), time)
    loop.babble(0.5)
    assert largest(robot) <= MOST
    assert (np.abs(robot.q) <= 1.0).all()


def test_a_start_outside_the_limits_is_brought_back_slowly(scene):
    robot = PlanarRobot(1.0)
    robot.q = np.array([2.0, 0.0, 0.0, 0.0])
    loop = ServoLoop(PlaneCamera(robot, scene), robot, device="cpu", seed=2)
    loop.babble(1.5)
    assert largest(robot) <= MOST
    assert robot.q[0] <= 1.0


@pytest.mark.parametrize("stamp", [1e9, -5.0, 1e300])
def test_one_wrong_joint_stamp_freezes_nothing(scene, stamp):
    robot, _, loop = make(scene)
    loop.babble(0.5)
    begin = len(robot.sent)
    robot.reads = lambda q, time: (q, stamp if len(robot.sent) == begin + 2 else time)
    flagged = []
    loop.on_frame = lambda loop: flagged.append(bool(loop.faults))
    loop.babble(1.0)
    assert any(flagged[:5])
    assert not any(flagged[8:])
    np.testing.assert_allclose(loop.frame.positions, robot.q, atol=1e-9)


@pytest.mark.parametrize("offset", [-20.0, -0.3, 60.0])
def test_a_joint_clock_that_is_set_is_said_and_the_robot_stands(scene, offset):
    robot, _, loop = make(scene)
    loop.babble(0.5)
    begin = robot.time
    robot.reads = lambda q, time: (q, time + (offset if time > begin + 0.2 else 0.0))
    loop.babble(1.0)
    assert loop.faults
    assert "clock" in str(loop.faults[0])
    still = np.array(robot.sent)[-10:]
    np.testing.assert_array_equal(still, 0)
    assert (np.abs(robot.q) <= 0.5).all()


def test_a_loop_that_is_told_so_takes_a_jump_as_it_is(scene):
    robot, _, loop = make(scene, limit=2.0)
    loop.babble(3.0)
    learned = np.array(loop.estimator.jacobian)
    robot.reads = lambda q, time: (q + 0.7, time)
    loop.babble(0.5)
    assert [fault.kind for fault in loop.faults] == ["reading"]
    loop.resume()
    assert not loop.faults
    flagged = []
    loop.on_frame = lambda loop: flagged.append(bool(loop.faults))
    loop.babble(0.5)
    assert not any(flagged)
    np.testing.assert_allclose(loop.frame.positions, robot.q + 0.7, atol=1e-9)
    assert np.abs(np.array(loop.estimator.jacobian) - learned).mean() < 0.2 * np.abs(learned).mean()


def test_after_a_pause_it_goes_on_where_the_robot_is_now(scene):
    robot, _, loop = make(scene, limit=2.0)
    loop.babble(3.0)
    robot.q, robot.time = robot.q + np.array([0.3, -0.2, 0.1, 0.0]), robot.time + 60.0
    flagged = []
    loop.on_frame = lambda loop: flagged.append(bool(loop.faults))
    loop.babble(61.0)
    assert not any(flagged)
    np.testing.assert_allclose(loop.frame.positions, robot.q, atol=1e-9)


@pytest.mark.parametrize("seconds", [1.9, 2.5])
@pytest.mark.parametrize("how", ["nan", "frozen"])
def test_readings_that_were_not_believed_for_long_are_taken_up_again(scene, seconds, how):
    """Images go on meanwhile, and nothing but the readings themselves says that they were not there."""
    robot = PlanarRobot(0.5)
    loop = ServoLoop(PlaneCamera(robot, scene), robot, device="cpu", seed=2, body_model=False)
    loop.babble(1.0)
    begin, last = robot.time, [robot.joints()]

    def reads(q, time):
        if begin + 0.2 < time < begin + 0.2 + seconds:
            return (q * np.nan, time) if how == "nan" else last[0]
        last[0] = q.copy(), time
        return last[0]

    robot.reads = reads
    said = set()
    loop.on_frame = lambda loop: said.update(fault.kind for fault in loop.faults)
    loop.babble(seconds + 1.5)
    assert said & {FaultKind.READING, FaultKind.CLOCK}
    assert robot.time - begin > seconds + 1.4
    np.testing.assert_allclose(loop.joints.newest, robot.q, atol=1e-6)
    assert np.abs(robot.sent[-1]).max() > 0  # it babbles on


def test_a_joint_that_is_stuck_is_named_and_the_others_go_on(scene):
    robot, _, loop = make(scene)
    loop.babble(4.0)
    robot.follows[0] = False
    before = robot.q.copy()
    loop.babble(2.0)
    assert any("x stays at" in str(fault) for fault in loop.faults)
    assert robot.q[0] == before[0]
    assert np.abs(robot.q[1:] - before[1:]).min() > 0.005
    loop.define_point([60.0, 50.0])
    assert any(fault.kind == "stuck joint" for fault in loop.reach([62.0, 55.0], max_frames=20).faults)


def test_joints_and_camera_on_clocks_of_their_own_are_refused(scene):
    robot = PlanarRobot()
    robot.reads = lambda q, time: (q, time + 1.7e9)
    with pytest.raises(DenseVSError, match=r"joint stamps? .*clock"):
        ServoLoop(PlaneCamera(robot, scene), robot, device="cpu")
    assert not robot.sent


def test_a_frozen_camera_with_fresh_stamps_stops_the_robot(scene):
    robot, camera, loop = make(scene)
    loop.babble(3.0)
    frozen = scene.image(robot.q)
    camera.sees = lambda image, time: (frozen, time)
    flagged = []
    loop.on_frame = lambda loop: flagged.append(bool(loop.faults))
    before = robot.q.copy()
    loop.babble(1.0)
    assert np.argmax(flagged) < 3
    assert all(flagged[3:])
    assert np.abs(robot.q - before).max() < 3 * MOST
    camera.sees = lambda image, time: (image, time)
    flagged.clear()
    loop.babble(1.0)
    assert not any(flagged[3:])


@pytest.mark.parametrize(
    "options",
    [{"settle_frames": 0}, {"settle_frames": -1}, {"tolerance": np.inf}, {"tolerance": -1.0}, {"max_frames": 0}],
)
def test_a_reach_that_would_say_reached_at_once_is_refused(scene, options):
    robot, _, loop = make(scene)
    loop.define_point([60.0, 50.0])
    with pytest.raises(DenseVSError, match=f"{next(iter(options))} is .*expected"):
        loop.reach([85.0, 50.0], **options)
    assert not robot.sent
