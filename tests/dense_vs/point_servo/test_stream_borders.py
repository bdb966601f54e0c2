"""When the delay of joint readings is sought, what changes it, and bilinear samples, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.health import Fault, FaultKind, JointWatch
from dense_vs.health.gain_check import GainChange
from dense_vs.point_servo import joint_stream
from dense_vs.point_servo.joint_stream import JointStream
from dense_vs.point_servo.tracker import sample
from dense_vs.robot import JointGroup

FRAME = 1 / 30


class Robot:
    def __init__(self):
        self.q, self.stamp = np.array([1.0, 9.0, 2.0]), 5.0

    def joints(self):
        return self.q.copy(), self.stamp


def stream_of(delay=0.0):
    robot, names = Robot(), ("a", "c")
    group = JointGroup.choose(names, ("a", "b", "c"))
    return JointStream(robot, group, JointWatch(names, np.full(2, 0.1)), delay), robot


def read(stream, robot, count):
    for _ in range(count):
        assert stream.read(robot.stamp) == ()
        robot.stamp += FRAME
        robot.q = robot.q + np.array([0.01, 5.0, 0.02])


def test_readings_are_interpolated_to_the_image_s_time():
    stream, robot = stream_of()
    read(stream, robot, 5)
    np.testing.assert_allclose(stream.newest, [1.04, 2.08])
    assert stream.newest_time == pytest.approx(5 + 4 * FRAME)
    np.testing.assert_allclose(stream.at(5 + 1.5 * FRAME), [1.015, 2.03])
    assert stream.has(5 + 4 * FRAME)
    assert stream.has(5 + 4 * FRAME + 5e-7)  # stamps are rounded sums
    assert not stream.has(5 + 4.1 * FRAME)
    behind, robot = stream_of(delay=2 * FRAME)
    read(behind, robot, 5)
    np.testing.assert_allclose(behind.at(5.0), [1.02, 2.04])
    assert behind.has(5 + 2 * FRAME)
    assert not behind.has(5 + 2.1 * FRAME)
    assert not behind.finding


def test_readings_of_long_ago_are_told_as_long_as_they_are_kept():
    stream, robot = stream_of(delay=FRAME)
    read(stream, robot, 8192)
    np.testing.assert_allclose(stream.kept_at(5 + FRAME), [1.02, 2.04])  # with the delay as it is known by now
    np.testing.assert_allclose(stream.kept_at(5 - FRAME), [1.0, 2.0])
    assert stream.kept_at(5 - 1.1 * FRAME) is None
    read(stream, robot, 1)  # for which there is no room: the older half goes
    assert stream.kept_at(5 + 4000 * FRAME) is None
    np.testing.assert_allclose(stream.kept_at(5 + 4200 * FRAME), [43.01, 86.02])


def test_a_reading_that_cannot_be_is_not_kept():
    stream, robot = stream_of()
    read(stream, robot, 5)
    before = stream.newest.copy()
    robot.q = robot.q + np.array([3.0, 0.0, 0.0])
    (fault,) = stream.read(robot.stamp)
    assert fault.kind is FaultKind.READING
    np.testing.assert_array_equal(stream.newest, before)
    assert not stream.has(robot.stamp)
    stream.restart()
    assert stream.read(robot.stamp) == ()
    np.testing.assert_allclose(stream.newest, robot.q[[0, 2]])


def finder(monkeypatch, delays):
    """A stream that is to find its delay, told these one after the other, and what was asked: curves and finds."""
    asked, answers = [], iter(delays)

    def curve(flows, pairs, stamps, positions, frame_time):
        asked.append({"flows": flows, "pairs": pairs, "stamps": stamps, "frame_time": frame_time})
        return f"curve {len(asked)}"

    def find(curves, frame_time):
        asked[-1] |= {"curves": list(curves), "of": frame_time}
        return next(answers)

    monkeypatch.setattr(joint_stream, "babbling_curve", curve)
    monkeypatch.setattr(joint_stream, "find_joint_delay", find)
    return *stream_of(delay=None), asked


def babble(stream, robot, frames, flow=None):
    """What the delay changed by in each of some frames, for as long as it is sought."""
    changes = []
    seen = np.zeros((24, 32, 2), np.float32) if flow is None else flow
    for _ in range(frames):
        read(stream, robot, 1)
        if stream.finding:
            changes.append(stream.find_delay(SimpleNamespace(time=robot.stamp, held=False, flow=seen)))
    return changes


@pytest.mark.parametrize("found", [0.05, 0.0])
def test_the_delay_is_sought_once_sixty_motions_and_three_more_readings_were_seen(monkeypatch, found):
    stream, robot, asked = finder(monkeypatch, [found])
    flow = np.zeros((24, 32, 2), np.float32)
    flow[4::8, 4::8] = [1.0, 2.0]
    flow[4, 4, 0] = np.nan
    changes = []
    for k in range(65):
        read(stream, robot, 1)  # one frame after the other
        held = k == 10  # not used: the next motion begins where this one would have
        unseen = k == 0 or held
        changes.append(
            stream.find_delay(SimpleNamespace(time=robot.stamp, held=held, flow=None if unseen else flow * (k + 1)))
        )
    assert not any(changes)
    robot.stamp += FRAME
    assert asked == []
    changes += babble(stream, robot, 3, flow)
    assert [change for change in changes if change] == [found] * (found > 0)
    assert stream.finding
    assert stream.delay == found
    (given,) = asked
    assert given["pairs"].shape == (60, 2)
    spans = np.diff(given["pairs"], axis=1).ravel() / FRAME
    np.testing.assert_allclose(spans[:12], [1] * 9 + [2, 1, 1])
    assert given["flows"].shape == (60, 3 * 4 * 2)
    np.testing.assert_allclose(given["flows"][0][:4], [0.0, 4.0, 2.0, 4.0])  # unknown is none
    assert given["curves"] == ["curve 1"]
    assert given["frame_time"] == given["of"] == pytest.approx(FRAME)


def test_the_delay_is_found_anew_from_all_of_the_babbling(monkeypatch):
    """None where the motion does not tell it, and less than a tenth of a frame, leave it as it is."""
    delays = [None, 0.04, 0.04 + 0.09 * FRAME, None, 0.04 - 0.11 * FRAME, 0.0]
    stream, robot, asked = finder(monkeypatch, delays)
    changes = babble(stream, robot, 400)
    begun = [one["pairs"][0, 0] for one in asked]
    np.testing.assert_allclose(np.diff(begun), 45 * FRAME)
    np.testing.assert_allclose(
        [change for change in changes if change], [0.04, -0.11 * FRAME, -0.04 + 0.11 * FRAME], atol=1e-12
    )
    assert asked[-1]["curves"] == [f"curve {k}" for k in range(1, 7)]
    assert not stream.finding
    assert stream.delay == 0.0


def test_motions_from_before_a_change_of_the_clock_tell_nothing(monkeypatch):
    stream, robot, asked = finder(monkeypatch, [0.04, 0.1])
    babble(stream, robot, 80)
    assert len(asked) == 1
    stream._changed(FRAME)
    changed_at = robot.stamp
    changes = babble(stream, robot, 70)
    assert changes[:64] == [0.0] * 64
    assert [change for change in changes if change] == [pytest.approx(0.1 - FRAME)]
    assert asked[-1]["curves"] == ["curve 2"]
    assert asked[-1]["pairs"].min() > changed_at


def test_a_robot_that_stands_still_has_no_curve(monkeypatch):
    stream, robot, asked = finder(monkeypatch, [None])
    monkeypatch.setattr(joint_stream, "babbling_curve", lambda *given: asked.append({}))
    assert not any(babble(stream, robot, 80))
    assert asked == [{"curves": [], "of": pytest.approx(FRAME)}]


@pytest.mark.parametrize(
    ("now", "found", "text"),
    [
        (0.0, None, None),
        (0.0, 0.39 * FRAME, None),
        (0.0, 0.41 * FRAME, "joint readings are 0.014 s behind the images now; taken out"),
        (0.1, 0.1 - 0.41 * FRAME, "joint readings are 0.086 s behind the images now; taken out"),
        (0.1, 0.1 - 0.39 * FRAME, None),
        (0.0, -0.1, "images come 0.100 s later than their stamps say; taken out"),
        (0.1, 0.0, "images come when their stamps say again"),
    ],
)
def test_a_delay_that_changed_is_taken_out(monkeypatch, now, found, text):
    given = {}

    def find(flows, jacobians, pairs, times, positions, *, now, frame_time):
        given.update(flows=flows, jacobians=jacobians, pairs=pairs, now=now, frame_time=frame_time)
        return found

    monkeypatch.setattr(joint_stream, "find_changed_delay", find)
    stream, robot = stream_of(delay=now)
    read(stream, robot, 3)
    motions = [SimpleNamespace(flow=f"u{k}", jacobian=f"J{k}", begin=k, end=k + 1) for k in range(4)]
    told = SimpleNamespace(faults=(Fault(FaultKind.MISFIT, "", stops=False),))
    changed = stream.judge_motion(told, SimpleNamespace(recent=motions, last=None))
    assert given["flows"] == ["u1", "u2", "u3"]  # the first may span the change
    assert given["jacobians"] == ["J1", "J2", "J3"]
    assert given["pairs"].tolist() == [[1, 2], [2, 3], [3, 4]]
    assert (given["now"], given["frame_time"]) == (now, pytest.approx(FRAME))
    if text is None:
        assert changed is None
        assert stream.delay == now
        return
    fault, since = changed
    assert since == 1  # the end of the first
    assert (fault.kind, fault.text, fault.stops, fault.holds) == (FaultKind.LATE, text, False, False)
    assert stream.delay == found


def test_a_slip_is_taken_out_from_the_image_on_that_first_shows_it():
    """Readings come three frames late: that of an image bears a later stamp, and so does the slip's beginning."""
    stream, robot = stream_of(delay=3 * FRAME)
    read(stream, robot, 12)
    begin = 5 + 2 * FRAME
    stream._gain_check = SimpleNamespace(judge=lambda *_: GainChange(0, 0.7, begin), restart=lambda: None)
    last = SimpleNamespace(begin=5 + 6 * FRAME, end=5 + 8 * FRAME, trusted=True)
    fault, since = stream.judge_motion(SimpleNamespace(time=last.end, faults=()), SimpleNamespace(last=last))
    assert (fault.kind, since) == (FaultKind.SLIP, begin)
    for k in range(9):  # images
        a = 1.03 + 0.01 * k if k <= 2 else 1.05 + 0.007 * (k - 2)
        np.testing.assert_allclose(stream.at(5 + k * FRAME), [a, 2.06 + 0.02 * k])
    np.testing.assert_allclose(stream.newest, [1.05 + 0.007 * 6, 2.22])


def test_samples_are_bilinear_and_those_of_the_border_outside():
    y, x = np.mgrid[:4, :6].astype(float)
    image = np.stack([2 * x + 3 * y + x * y, x], axis=2)
    places = np.array(
        [[0.0, 0.0], [5.0, 3.0], [1.25, 2.5], [4.75, 0.5], [-3.0, 1.0], [9.0, 1.5], [2.5, -1.0], [2.5, 7.0]]
    )
    inside = np.clip(places, 0, [5, 3])
    expected = np.column_stack([2 * inside[:, 0] + 3 * inside[:, 1] + inside[:, 0] * inside[:, 1], inside[:, 0]])
    np.testing.assert_allclose(sample(image, places), expected, atol=1e-12)
