"""A process apart watches a session: it has the robot hold where the session is killed or hangs, and only there."""

import os
import select
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from sliding_scene import SlidingRobot, wait_for

from dense_vs.drivers.watchdog import Hold, Watchdog
from dense_vs.live import session as session_module
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource

SUPPORT = Path(__file__).parents[2] / "support"
PROGRAM = """
import sys, time
from sliding_scene import SlidingRobot
from dense_vs.drivers.watchdog import Hold
from dense_vs.live.options import LiveOptions
from dense_vs.live.mode import Mode
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource
robot = SlidingRobot()
hold = Hold("held_robot:hold", {"path": sys.argv[1], "robot": "board"}, timeout=float(sys.argv[2]))
session = LiveSession(
    LiveSource(robot, robot, "board", watchdog=hold), LiveOptions(body=False, labels=False)
)
session.start()
while session.mode is not Mode.STILL:
    time.sleep(0.01)
session.ask(lambda: session.begin_mode(Mode.LEARNING))
while not robot.moved_since(0.0):
    time.sleep(0.01)
print("moving", flush=True)
time.sleep(120)
"""


@pytest.fixture
def path(tmp_path, monkeypatch):
    """Where the watchdog writes that it had the robot hold."""
    monkeypatch.setenv("PYTHONPATH", str(SUPPORT))
    return tmp_path / "held.json"


@contextmanager
def moving(path, timeout):
    """A process whose session moves its robot, watched with that timeout [s]."""
    words = [sys.executable, "-c", PROGRAM, str(path), str(timeout)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        ready, _, _ = select.select([process.stdout], [], [], 100)
        assert ready
        # Warp tells of itself first.
        assert any(line == "moving\n" for line in process.stdout)
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_killed_session_leaves_a_robot_that_holds(path):
    with moving(path, timeout=30.0) as process:
        assert not path.exists()
        os.kill(process.pid, signal.SIGKILL)
        assert wait_for(path.exists, 20)


def test_a_session_that_hangs_does_too(path):
    for timeout in (1.0, 4.0, 16.0):
        with moving(path, timeout) as process:
            if path.exists():  # on a busy computer, whose frames may be that late: it holds once
                path.unlink()
                continue
            os.kill(process.pid, signal.SIGSTOP)
            assert wait_for(path.exists, 60)
            return
    pytest.fail("every watch had the robot hold before its session hung")


def test_a_session_that_lives_says_so_with_every_frame_and_ends_its_watch(path, monkeypatch):
    started = []

    class Counted(Watchdog):
        def __init__(self, hold):
            super().__init__(hold)
            self.beats = 0
            started.append(self)

        def beat(self):
            self.beats += 1
            super().beat()

    monkeypatch.setattr(session_module, "Watchdog", Counted)
    robot, hold = SlidingRobot(), Hold("held_robot:hold", {"path": str(path), "robot": "board"}, timeout=100.0)
    session = LiveSession(
        LiveSource(robot, robot, "board", watchdog=hold), LiveOptions(body=False, labels=False, folder=path.parent)
    )
    session.start()
    (watchdog,) = started
    try:
        assert wait_for(lambda: session.mode is Mode.STILL and session.number > 5, 60), session.board.lines()
        robot.stalled.set()
        assert wait_for(lambda: watchdog.beats == session.number)  # the frame in work may end yet
        assert watchdog.alive
        robot.stalled.clear()
    finally:
        session.end()
    assert not watchdog.alive
    assert not path.exists()
