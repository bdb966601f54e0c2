"""A delay that one motion told is taken where the next agrees, and stays where those after it do; by hand and in the
stream of readings.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from read_path import FRAME, JOINTS, NAMES, PLACES, Path

from dense_vs.health.faults import Fault, FaultKind
from dense_vs.health.joint_watch import JointWatch
from dense_vs.health.motion_check import Motion, MotionCheck
from dense_vs.point_servo import joint_stream
from dense_vs.point_servo.delay_trial import DelayTrial
from dense_vs.point_servo.joint_stream import JointStream
from dense_vs.robot.joint_group import JointGroup

TIMES = np.arange(200) * FRAME


def motion_at(robot, k, late, rng, still=False):
    """Between images k - 1 and k, that show the robot so many frames later."""
    J = rng.normal(0, 60, (PLACES, 2, JOINTS)) * (np.arange(PLACES) < PLACES // 2)[:, None, None]
    begin, end = (k - 1) * FRAME, k * FRAME
    step = 0 * robot.at(end) if still else robot.at(end + late * FRAME) - robot.at(begin + late * FRAME)
    return Motion(begin, end, J @ step + rng.normal(0, 0.1, (PLACES, 2)), J * (1 + 0.1 * rng.normal(size=J.shape)))


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize(("true", "told"), [(1, -1), (1, 1), (0, -2), (-2, -2), (0, 5), (-5, -5), (3, 3)])
def test_the_motions_since_decide(seed, true, told):
    robot, rng = Path(seed), np.random.default_rng([seed, 7])
    other = {1: -1, -1: 1, -2: 0, 5: 0, -5: 0, 3: 0}[told]
    trial = DelayTrial(other * FRAME, told * FRAME, 100 * FRAME, FRAME)
    trial.taken = True
    for k in range(101, 180):
        known = (k + 0.1) * FRAME >= TIMES  # as a stream has them: later ones come later
        better = trial.judge(motion_at(robot, k, true, rng), TIMES[known], robot.path[known])
        if better is not None:
            break
    assert better == true * FRAME
    assert k >= 100 + 8 + max(0, other, told)  # eight motions, whose readings are there


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize(
    ("true", "told", "found"),
    [(0, -0.9, 0), (-2, -3, -2), (-2, -1.2, -2), (-3, -3.3, -3.3), (-0.6, -1.5, 0), (2, 3.4, 2), (2.5, 1.1, 2.5)],
)
def test_the_motions_that_decide_tell_the_delay_anew(seed, true, told, found):
    """One motion tells it to about a frame; two fifths beside it are left, and three quarters are none."""
    robot, rng = Path(seed), np.random.default_rng([seed, 7])
    trial = DelayTrial(-5 * FRAME, told * FRAME, 100 * FRAME, FRAME)
    trial.taken = True
    for k in range(101, 180):
        known = (k + 0.1) * FRAME >= TIMES
        better = trial.judge(motion_at(robot, k, true, rng), TIMES[known], robot.path[known])
        if better is not None:
            break
    assert better / FRAME == pytest.approx(found, abs=0.1 if found else 0)


@pytest.mark.parametrize(("until", "found"), [(105.5, -0.9), (106.5, 0)])
def test_four_motions_whose_readings_are_there_tell_it_anew(until, found):
    robot, rng = Path(3), np.random.default_rng(7)
    trial = DelayTrial(-5 * FRAME, -0.9 * FRAME, 100 * FRAME, FRAME)
    trial.taken = True
    known = until * FRAME > TIMES  # two frames after the delay on trial the readings of three, of six
    motions = [motion_at(robot, k, 0, rng) for k in (101, 102, 103, 104, 105, 104, 105, 104)]
    decided = [trial.judge(motion, TIMES[known], robot.path[known]) for motion in motions]
    assert decided == [None] * 7 + [found * FRAME]


def test_motions_before_it_and_those_of_a_robot_at_rest_say_nothing():
    robot, rng = Path(2), np.random.default_rng(7)
    trial = DelayTrial(0.0, -2 * FRAME, 100 * FRAME, FRAME)
    trial.taken = True
    for k in range(60, 101):  # the last of them ends with the image that told it
        assert trial.judge(motion_at(robot, k, 0, rng), TIMES, robot.path) is None
    still = np.full_like(robot.path, 0.1)
    for k in range(101, 190):
        assert trial.judge(motion_at(robot, k, 0, rng, still=True), TIMES, still) is None
        assert trial.judge(None, TIMES, still) is None
    decided = [trial.judge(motion_at(robot, k, 0, rng), TIMES, robot.path) for k in range(101, 109)]
    assert decided == [None] * 7 + [0.0]


def test_even_motion_that_both_explain_alike_is_decided_at_last():
    robot, rng = Path(2), np.random.default_rng(7)
    robot.path = np.outer(np.arange(200), np.full(JOINTS, 0.01))
    trial = DelayTrial(0.0, -2 * FRAME, 100 * FRAME, FRAME)
    trial.taken = True
    decided = [trial.judge(motion_at(robot, k, 0, rng), TIMES, robot.path) for k in range(101, 161)]
    assert decided[:-1] == [None] * 59
    assert decided[-1] in (0.0, -2 * FRAME)


@pytest.mark.parametrize(("true", "told"), [(0, -2), (-2, -2), (0, 5)])
def test_one_motion_decides_whether_a_delay_is_taken(true, told):
    robot, rng = Path(3), np.random.default_rng(7)
    trial = DelayTrial(0.0, told * FRAME, 100 * FRAME, FRAME)
    known = TIMES <= 107 * FRAME
    assert trial.judge(None, TIMES[known], robot.path[known]) is None
    assert trial.judge(motion_at(robot, 100, true, rng), TIMES[known], robot.path[known]) is None  # that told it
    assert trial.judge(motion_at(robot, 101, true, rng), TIMES[known], robot.path[known]) == true * FRAME


def test_even_motion_speaks_against_no_delay_that_is_not_yet_taken():
    robot, rng = Path(2), np.random.default_rng(7)
    robot.path = np.outer(np.arange(200), np.full(JOINTS, 0.01))
    trial = DelayTrial(0.0, -2 * FRAME, 100 * FRAME, FRAME)
    assert trial.judge(motion_at(robot, 101, 0, rng), TIMES, robot.path) == -2 * FRAME


@pytest.mark.parametrize(
    ("true", "next_like", "taken", "back"),
    [(-2, -2, True, False), (0, 0, False, False), (0, -2, True, True)],
    ids=["it is late", "chance", "chance twice"],
)
def test_a_stream_takes_a_delay_that_the_next_motion_agrees_with_and_goes_back(
    monkeypatch, true, next_like, taken, back
):
    robot, rng = Path(3), np.random.default_rng(7)
    group = JointGroup.choose(NAMES, NAMES)
    stream = JointStream(robot, group, JointWatch(NAMES, np.full(JOINTS, 0.1)), 0.0)
    monkeypatch.setattr(joint_stream, "find_jumped_delay", lambda *of, **options: -2 * FRAME)
    check, misfit, changes = MotionCheck(), Fault(FaultKind.MISFIT, "", stops=False), []
    for k in range(1, 140):
        robot.time = k * FRAME
        stream.read(robot.time)
        motion = motion_at(robot, k, next_like if k == 101 else true, rng)
        check.judge(motion.flow, motion.jacobian, robot.at(robot.time), motion.begin, motion.end)
        if k == 100:
            check.recent.append(motion)
        frame = SimpleNamespace(time=motion.end, faults=(misfit,) if k == 100 else ())
        if (changed := stream.judge_motion(frame, check)) is not None:
            changes.append((k, *changed))
            check.forget_doubt()
        if k == 100:
            assert stream.delay == 0.0  # not before another motion
    assert stream.delay == true * FRAME
    assert len(changes) == taken + back
    if taken:
        (first, told, since), *_ = changes
        assert (first, since) == (101, 100 * FRAME)
        assert "images come 0.067 s later" in told.text
    if back:
        when, said, since = changes[1]
        assert when >= 108
        assert since == 100 * FRAME  # all images from that one on are meant
        assert said.text == "images come when their stamps say again"
        assert (said.kind, said.stops) == (FaultKind.LATE, False)
