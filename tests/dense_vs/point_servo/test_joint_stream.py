"""A delay of joint readings that changes while J is known is noticed by its motion, said and taken out."""

from types import SimpleNamespace

import numpy as np
import pytest
from read_path import FRAME, JOINTS, NAMES, PLACES, Path

from dense_vs.health import FaultKind, JointWatch
from dense_vs.health.motion_check import BABBLING_SHARE, MotionCheck
from dense_vs.point_servo.joint_stream import JointStream
from dense_vs.robot import JointGroup


def judged(seed, frames, jump=False):
    """The first change that is found where, from image 100 on, images show that many frames later than stamped.

    Without ``jump`` the first of them is compared with one that is as late: nothing tells it but later motion.
    """
    robot, rng = Path(seed), np.random.default_rng([seed, 1])
    group = JointGroup.choose(NAMES, NAMES)
    stream = JointStream(robot, group, JointWatch(NAMES, np.full(JOINTS, 0.1)), 0.0)
    check = MotionCheck()
    check.least_share = BABBLING_SHARE
    true = rng.normal(0, 60, (PLACES, 2, JOINTS))
    true[PLACES // 2 :] = 0.0
    learned = true * (1 + 0.1 * rng.normal(size=true.shape))
    for k in range(131):
        robot.time = k * FRAME
        stream.read(robot.time)
        if k < 1:
            continue
        shift = frames * FRAME if k > 100 else 0.0
        begin, end = (k - 1) * FRAME, k * FRAME
        flow = true @ (robot.at(end + shift) - robot.at(begin + (0.0 if jump and k == 101 else shift))) + rng.normal(
            0, 0.15, (PLACES, 2)
        )
        fault = check.judge(flow, learned, stream.at(end) - stream.at(begin), begin, end)
        found = stream.judge_motion(SimpleNamespace(time=end, faults=() if fault is None else (fault,)), check)
        if found is not None:
            assert found[1] == check.recent[0].end
            return SimpleNamespace(fault=found[0], delay=stream.delay, frame=k)
    return None


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize("frames", [-3.0, -2.0, -1.5])
def test_images_that_begin_to_come_late_are_said_and_taken_out(seed, frames):
    found = judged(seed, frames)
    assert found.delay == pytest.approx(frames * FRAME, abs=0.3 * FRAME)
    assert found.fault.kind is FaultKind.LATE
    assert "images come" in str(found.fault)
    assert found.frame < 125


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize("frames", [-3.0, -2.0])
def test_the_first_late_image_and_the_next_tell_where_the_robot_moves(seed, frames):
    found = judged(seed, frames, jump=True)
    assert found.delay == pytest.approx(frames * FRAME, abs=0.3 * FRAME)
    assert found.frame == 102


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_on_time_nothing_changes(seed):
    assert judged(seed, 0.0) is None
