"""The session on a board that slides: it learns, reaches the truth, and stops whatever happens."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from sliding_scene import HEIGHT, WIDTH, J, SlidingRobot, wait_for

from dense_vs.errors import DenseVSError
from dense_vs.health import FaultKind
from dense_vs.live.actions import Actions, parse
from dense_vs.live.gate import GatedRobot
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions, chosen_scale
from dense_vs.live.recording_thread import RecordingThread
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource
from dense_vs.robot.babbling import Babbling

CENTER = (WIDTH / 2, HEIGHT / 2)


def session_of(robot, **options):
    return LiveSession(LiveSource(robot, robot, "board"), LiveOptions(body=False, labels=False, **options))


@pytest.fixture
def robot():
    return SlidingRobot()


@pytest.fixture
def session(robot, tmp_path):
    session = session_of(robot, folder=tmp_path)
    session.start()
    assert wait_for(lambda: session.board.snapshot is not None, 60), session.board.lines()
    assert session.mode is Mode.STILL
    yield session
    session.end()


def said(session, word):
    return any(word in line["text"] for line in session.board.lines())


def do(session, **message):
    Actions(session).carry_out(message)


def test_a_session_ends_what_it_has_begun_and_nothing_else(robot, tmp_path):
    """Before its first frame too, when there is no body's process yet."""
    ended = []
    session_of(robot, folder=tmp_path).end()
    session = session_of(robot, folder=tmp_path)
    session.body = SimpleNamespace(end=lambda: ended.append("body"))
    session.end()
    assert ended == ["body"]


def test_nothing_moves_until_asked(session, robot):
    assert wait_for(lambda: len(robot.commands) > 10)
    assert not any(step.any() for _, step in robot.commands)
    assert not session.gate.open


def test_it_learns_stops_by_itself_and_reaches(session, robot):
    do(session, do="learn")
    assert wait_for(lambda: said(session, "learned: J explains"), 60), session.board.lines()
    assert session.mode is Mode.STILL
    np.testing.assert_allclose(session.running_loop().estimator.at(CENTER)[0], J, atol=6.0)
    start = CENTER - J @ robot.q  # where what is at the center now is for joints at zero
    do(session, do="point", at=list(CENTER), frame=1 << 40)
    assert wait_for(lambda: len(session.points) == 1)
    target = [CENTER[0] + 14, CENTER[1] - 9]
    do(session, do="aim", point=1, target=target, go=True)
    assert wait_for(lambda: said(session, "point 1: reached"), 30), session.board.lines()
    assert np.hypot(*(robot.place(start) - target)) < 2.0


@pytest.mark.parametrize("fault", ["stop", "stall", "joints", "error", "dark"])
def test_every_fault_stops_commands(session, robot, fault):
    do(session, do="learn")
    assert wait_for(lambda: robot.moved_since(0.0))
    # Black images come on: a frame that is late must not be taken for the fault.
    session.options.__dict__["stall_seconds"] = 1.0 if fault == "dark" else 0.3
    if fault == "stop":
        session.stop("the test")
    elif fault == "stall":
        robot.stalled.set()
    elif fault == "joints":
        robot.frozen = True
    elif fault == "dark":
        robot.dark = True
    else:
        robot.broken = OSError("the cable is out")
    assert wait_for(lambda: not session.gate.open, 20 if fault == "dark" else 5)
    closed = time.monotonic()
    assert wait_for(lambda: robot.holds == 1)  # just after the gate is closed
    robot.stalled.clear()
    robot.dark = False
    count = len(robot.commands)
    assert wait_for(lambda: len(robot.commands) > count + 5), (
        session.board.lines()
    )  # images come again, and nothing goes on by itself
    assert not robot.moved_since(closed + 0.005)  # a command may have passed the gate just before
    assert wait_for(lambda: session.mode is Mode.STILL)
    words = {"stall": "camera stalled", "joints": "joint readings", "error": "cable is out", "dark": "contrast 0.0"}
    assert words.get(fault, "the test") in session.gate.reason
    assert robot.holds == 1


def test_a_stop_holds_back_the_command_in_work(robot):
    """The step is decided, the stop comes, the step is sent: it must not move the robot."""
    session = session_of(robot)
    gated: GatedRobot = session.robot
    gated.joints()
    session.gate.allow()
    step = np.array([0.01, 0.01])
    session.stop("now")
    gated.command(step)
    assert not robot.commands[-1][1].any()


def test_a_robot_that_cannot_hold_is_said_and_stays_stopped(robot):
    def hold():
        raise OSError("the bus is gone")

    robot.hold = hold
    session = session_of(robot)
    session.robot.joints()
    session.gate.allow()
    session.stop("a key")
    (line,) = (line for line in session.board.lines() if line["level"] == "error")
    assert line["text"] == "the robot was told to hold and did not: OSError: the bus is gone"
    assert session.gate.reason == "a key"
    session.robot.command(np.array([0.01, 0.01]))
    assert not robot.commands[-1][1].any()


def test_the_loop_knows_how_slow_a_sliding_joint_is(robot, tmp_path):
    """It watches whether joints follow, so what it sends has to be what passes."""
    robot.joint_units = ("rad", "m")
    session = session_of(robot, folder=tmp_path, joints=("right", "left"), max_speed=0.08)
    session.start()
    try:
        assert wait_for(lambda: session.mode is Mode.STILL and session.number > 2, 60), session.board.lines()
        frame = session.robot.frame_seconds
        np.testing.assert_allclose(session.running_loop().gate.max_step, [0.02 * frame, 0.08 * frame], rtol=1e-6)
    finally:
        session.end()


@pytest.mark.parametrize("given", [None, 0.05])
def test_joints_babble_as_far_as_asked(robot, tmp_path, given):
    session = session_of(robot, folder=tmp_path, joints=("left",), amplitude=given, seed=3)
    session.start()
    try:
        assert wait_for(lambda: session.mode is Mode.STILL and session.number > 2, 60), session.board.lines()
        babbling = session.running_loop().babbling
        assert (babbling.joints, babbling.options.amplitude) == (1, given or 0.15)
        assert babbling.step() == Babbling(1, seed=3, amplitude=given or 0.15).step()
    finally:
        session.end()


def test_the_loop_knows_a_speed_that_the_page_has_changed(session, robot):
    do(session, do="speed", value=0.05)
    do(session, do="learn")
    found = set()

    def enough():
        found.update(fault.kind for fault in session.running_loop().faults)
        return sum(step.any() for _, step in tuple(robot.commands)) > 30

    assert wait_for(enough, 60), session.board.lines()
    largest = 0.05 * session.robot.frame_seconds
    np.testing.assert_allclose(session.running_loop().gate.max_step, largest, rtol=1e-6)
    assert max(np.abs(step).max() for _, step in tuple(robot.commands)) <= largest * (1 + 1e-6)
    assert FaultKind.STUCK not in found


@pytest.mark.parametrize("asked", ["learn", "go"])
def test_a_stop_ends_what_was_asked_for_before_it_and_has_not_begun(session, robot, asked):
    """The camera hangs, motion is asked for, Stop is pressed, and the camera comes back: nothing moves."""
    do(session, do="point", at=list(CENTER), frame=1 << 40)
    do(session, do="aim", point=1, target=[CENTER[0] + 9, CENTER[1]])
    assert wait_for(lambda: len(session.points) == 1)
    robot.stalled.set()
    time.sleep(0.1)  # the loop waits for an image
    do(session, do=asked)
    session.stop("a key")
    robot.stalled.clear()
    assert wait_for(lambda: said(session, "a stop came after the motion was asked for")), session.board.lines()
    count = len(robot.commands)
    assert wait_for(lambda: len(robot.commands) > count + 5)
    assert session.mode is Mode.STILL
    assert not robot.moved_since(0.0)
    do(session, do="learn")  # and when it is asked for again, it does
    assert wait_for(lambda: robot.moved_since(0.0))


def test_two_points_share_the_joints(session, robot):
    do(session, do="learn")
    assert wait_for(lambda: said(session, "learned: J explains"), 60)
    for place in ([50.0, 60.0], [110.0, 60.0]):
        do(session, do="point", at=place, frame=1 << 40)
    assert wait_for(lambda: len(session.points) == 2)
    do(session, do="weigh", point=1, weight=100)
    do(session, do="weigh", point=2, weight=1)
    before = robot.q.copy()
    # They cannot both be had, as the board does not stretch: the heavy one wins.
    do(session, do="aim", point=1, target=[60.0, 60.0], go=True)
    do(session, do="aim", point=2, target=[110.0, 70.0], go=True)
    assert wait_for(lambda: abs((J @ (robot.q - before))[0] - 10) < 1.5, 20)
    time.sleep(1.0)
    moved = J @ (robot.q - before)
    assert np.hypot(*(moved - [10, 0])) < 2.5


def test_a_recording_follows_no_commands(robot):
    session = LiveSession(LiveSource(robot, robot, "recording", commands=False), LiveOptions(body=False, labels=False))
    session.start()
    try:
        assert wait_for(lambda: session.mode is Mode.STILL, 60)
        do(session, do="learn")
        assert wait_for(lambda: said(session, "follows no commands"))
        assert not session.gate.open
    finally:
        session.end()


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"do": "rm"},
        {"do": "point", "at": [1], "frame": 1},
        {"do": "point", "at": [float("nan"), 1], "frame": 1},
        {"do": "point", "at": "11", "frame": 1},
        {"do": "point", "at": [1, 2], "frame": 1.5},
        {"do": "aim", "point": True},
        {"do": "speed", "value": 1e9},
        {"do": "dead_man", "on": 1},
    ],
)
def test_wrong_messages_are_refused(session, message):
    with pytest.raises(DenseVSError, match="expected"):
        do(session, **message)


@pytest.mark.parametrize("text", ["", "[]", "{", "null", "[" * 3000, "{}" + " " * 5000])
def test_what_is_no_message_is_refused(text):
    with pytest.raises(DenseVSError, match="message"):
        parse(text)


def test_points_outside_and_unknown_ones_are_said(session):
    do(session, do="point", at=[-5, 5], frame=0)
    do(session, do="remove", point=7)
    assert wait_for(lambda: said(session, "outside the image") and said(session, "point is 7"))


def test_a_recording_is_written_beside_the_loop(session, tmp_path):
    pytest.importorskip("av", reason="writing video needs PyAV")
    do(session, do="record", on=True)
    assert wait_for(lambda: session.recorder is not None)
    number = session.board.snapshot.number
    assert wait_for(lambda: session.board.snapshot.number > number + 15)
    do(session, do="record", on=False)
    assert wait_for(lambda: session.last_recording is not None and session.last_recording.done.is_set())
    assert session.last_recording.archive.is_file()
    from dense_vs.recording import open_recording

    episode = open_recording(session.last_recording.folder / "video.mp4").episode()
    assert episode.log.names == ("left", "right")
    assert len(list(episode)) >= 10


def test_a_reading_that_is_not_finite_is_left_out_of_a_recording(tmp_path):
    recorder = RecordingThread(tmp_path / "one", "video", ("left", "right"), 30.0, print)
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for k in range(12):
        recorder.add(image + np.uint8(k), k / 30, np.array([np.nan if k == 5 else 0.01 * k, 0.0]), k / 30)
    recorder.finish()
    assert not recorder.failed
    from dense_vs.recording import open_recording

    episode = open_recording(recorder.folder / "video.mp4").episode()
    assert len(episode.log.times) == 11
    assert np.isfinite(episode.log.positions).all()


def test_wide_images_are_made_smaller():
    assert chosen_scale(LiveOptions(), 320) == 1.0
    assert chosen_scale(LiveOptions(), 640) == 0.5
    assert chosen_scale(LiveOptions(scale=0.7), 640) == 0.7


def test_what_was_learned_is_kept_and_taken_up_at_the_next_start(tmp_path):
    options = {"folder": tmp_path, "checkpoint": tmp_path / "kept.npz"}
    first = session_of(SlidingRobot(), **options)
    first.start()
    try:
        assert wait_for(lambda: first.mode is Mode.STILL, 60)
        do(first, do="learn")
        assert wait_for(lambda: said(first, "learned: J explains"), 60), first.board.lines()
        assert wait_for((tmp_path / "kept.npz").is_file)
        first.stop("the robot stands while the last of it is kept")
        time.sleep(3.5)  # a period
        J_first = np.array(first.running_loop().estimator.at(CENTER)[0])
    finally:
        first.end()
    second = session_of(SlidingRobot(), **options)
    second.start()
    try:
        assert wait_for(lambda: second.mode is Mode.STILL, 60)
        assert said(second, "going on from"), second.board.lines()
        np.testing.assert_allclose(second.running_loop().estimator.at(CENTER)[0], J_first, atol=2.0)
    finally:
        second.end()


def test_a_checkpoint_of_another_robot_is_said_and_left_alone(tmp_path):
    path = tmp_path / "kept.npz"
    path.write_bytes(b"something else")
    session = session_of(SlidingRobot(), folder=tmp_path, checkpoint=path)
    session.start()
    try:
        assert wait_for(lambda: session.mode is Mode.STILL, 60)
        assert said(session, "no checkpoint is kept: cannot read"), session.board.lines()
        assert wait_for(lambda: session.number > 5)
        assert path.read_bytes() == b"something else"
    finally:
        session.end()
