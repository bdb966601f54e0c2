"""A belt slips between a motor's encoder and its joint: said, taken out of the positions, followed until it ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from read_path import FRAME, JOINTS, NAMES, PLACES, Path

from dense_vs.health import FaultKind, JointWatch
from dense_vs.health.motion_check import BABBLING_SHARE, MotionCheck
from dense_vs.point_servo.joint_stream import JointStream
from dense_vs.robot import JointGroup

BEGIN, END, FRAMES, GAIN = 320, 440, 560, 0.7
SPAN = 5  # frames that flow is measured over


class SlippingPath(Path):
    """Its second joint moves by a share of what its encoder says from one frame to another."""

    def __init__(self, seed, gain):
        super().__init__(seed, FRAMES)
        self.true = self.path.copy()
        steps = np.diff(self.path[:, 1])
        steps[BEGIN:END] *= gain
        self.true[1:, 1] = self.path[0, 1] + np.cumsum(steps)

    def moved_to(self, k):
        return self.true[k]


def run(seed, gain=GAIN, delay=0.0):
    """What is said frame by frame, and where the joints are thought to be."""
    robot, rng = SlippingPath(seed, gain), np.random.default_rng([seed, 1])
    group = JointGroup.choose(NAMES, NAMES)
    stream = JointStream(robot, group, JointWatch(NAMES, np.full(JOINTS, 0.1)), delay)
    check = MotionCheck()
    check.least_share = BABBLING_SHARE
    true = rng.normal(0, 60, (PLACES, 2, JOINTS))
    learned = true * (1 + 0.03 * rng.normal(size=true.shape))
    said, off, changes = [], [], []
    for k in range(FRAMES):
        robot.time = k * FRAME
        faults = stream.read(robot.time)
        said.append([str(fault) for fault in faults])
        assert not any(fault.stops or fault.holds for fault in faults)
        np.testing.assert_array_equal(stream.reading, robot.path[k])
        if k > 0 and k % SPAN == 0:
            begin, end = (k - SPAN) * FRAME, k * FRAME
            flow = true @ (robot.moved_to(k) - robot.moved_to(k - SPAN)) + rng.normal(0, 0.15, (PLACES, 2))
            fault = check.judge(flow, learned, stream.at(end) - stream.at(begin), begin, end)
            found = stream.judge_motion(SimpleNamespace(time=end, faults=() if fault is None else (fault,)), check)
            if found is not None:
                changes.append((k, *found))
                check.forget_doubt()
        np.testing.assert_allclose(stream.newest, stream.at(k * FRAME), atol=1e-12)
        off.append(stream.newest - robot.true[k])
    return said, np.array(off), changes, stream


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize("gain", [0.5, 0.7])
def test_a_slip_is_said_and_taken_out(seed, gain):
    said, off, changes, stream = run(seed, gain)
    (first, slips, since), (last, ends, _) = changes
    assert BEGIN < first < BEGIN + 100
    assert END < last < END + 100
    assert (BEGIN - SPAN) * FRAME <= since <= first * FRAME
    assert (slips.kind, slips.stops, slips.holds) == (FaultKind.SLIP, False, False)
    share = float(slips.text.split(" by ")[1].split()[0])
    assert share == pytest.approx(gain, abs=0.06)
    assert slips.text == f"b moves by {share:.2f} of what its readings say; taken out"
    assert ends.text == "b moves as its readings say again"
    assert [k for k in range(FRAMES) if said[k]] == list(range(first + 1, last + 1))
    assert all(said[k] == [f"slipping joint: {slips.text}"] for k in range(first + 1, last))
    np.testing.assert_array_equal(stream.gains, np.ones(JOINTS))
    assert np.abs(off[:, [0, 2, 3]]).max() < 1e-12  # the others are where they read
    way = np.abs(np.diff(SlippingPath(seed, gain).path[BEGIN : END + 1, 1])).sum()
    assert np.abs(off[last:, 1]).max() < (1 - gain) * 0.45 * way + 0.01  # a part of what it slipped; all without this
    assert np.abs(stream.slipped[[0, 2, 3]]).max() == 0


@pytest.mark.parametrize("seed", range(2, 6))
def test_a_robot_whose_joints_hold_is_not_said_to_slip(seed):
    said, off, changes, _ = run(seed, 1.0)
    assert not changes
    assert not any(said)
    assert np.abs(off).max() < 1e-12


def test_what_has_slipped_stays_after_a_gap():
    *_, stream = run(3)
    slipped = stream.slipped.copy()
    assert abs(slipped[1]) > 0
    stream.restart()
    np.testing.assert_array_equal(stream.slipped, slipped)
    assert stream.read(FRAMES * FRAME) == ()
    np.testing.assert_allclose(stream.newest, stream.reading + slipped)
    np.testing.assert_allclose(stream.at(FRAMES * FRAME), stream.reading + slipped)


def test_a_j_that_is_not_known_yet_tells_no_slip():
    stream = JointStream(
        SlippingPath(3, GAIN), JointGroup.choose(NAMES, NAMES), JointWatch(NAMES, np.full(JOINTS, 0.1)), 0.0
    )
    asked = []
    stream._gain_check = SimpleNamespace(judge=lambda *given: asked.append(given))
    for trusted in (False, True):
        last = SimpleNamespace(end=0.1, begin=0.0, trusted=trusted)
        stream._robot.time = 0.1 + trusted
        stream.read(stream._robot.time)
        stream.judge_motion(SimpleNamespace(time=0.1, faults=()), SimpleNamespace(last=last))
        assert bool(asked) == trusted
