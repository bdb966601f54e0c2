"""The watchdog: a loop that is killed leaves a robot that was told to hold, one that ends as it should does not."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dense_vs.drivers.watchdog import Hold, Watchdog
from dense_vs.errors import DenseVSError

SUPPORT = Path(__file__).parents[2] / "support"
LOOP = """
import sys, time
from dense_vs.drivers.watchdog import Hold, Watchdog
watchdog = Watchdog(Hold("held_robot:hold", {"path": sys.argv[1], "robot": "arm"}, timeout=float(sys.argv[2])))
print("running", flush=True)
while True:
    watchdog.beat()
    time.sleep(0.01)
"""


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(SUPPORT))
    return tmp_path / "held.json"


def held(path, seconds=20.0):
    end = time.monotonic() + seconds
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.02)
    return path.exists()


@pytest.fixture
def loop(path, request):
    """A process of its own that beats; ended here whatever the test does."""
    words = [sys.executable, "-c", LOOP, str(path), str(request.param)]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    )
    assert process.stdout.readline() == "running\n"
    time.sleep(1.0)  # the watchdog has begun to read
    assert not path.exists()
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.parametrize("loop", [30.0], indirect=True)
def test_a_killed_loop_leaves_a_robot_that_holds(loop, path):
    os.kill(loop.pid, signal.SIGKILL)
    assert held(path)
    assert json.loads(path.read_text()) == {"held": "arm"}


@pytest.mark.parametrize("loop", [30.0], indirect=True)
def test_what_ends_everything_in_the_loop_s_terminal_leaves_the_watchdog(loop, path):
    os.killpg(loop.pid, signal.SIGTERM)  # Ctrl+C's goes the same way, but may be ignored from the start
    assert held(path)


@pytest.mark.parametrize("loop", [0.5], indirect=True)
def test_a_loop_that_hangs_does_too(loop, path):
    os.kill(loop.pid, signal.SIGSTOP)
    try:
        assert held(path)
    finally:
        os.kill(loop.pid, signal.SIGCONT)


def test_a_loop_that_ends_as_it_should_leaves_the_robot_alone(path):
    watchdog = Watchdog(Hold("held_robot:hold", {"path": str(path), "robot": "arm"}, timeout=30.0))
    for _ in range(10):
        watchdog.beat()
    watchdog.end(timeout=20.0)
    assert not watchdog.alive
    assert not path.exists()
    watchdog.beat()  # of no use, and harmless


@pytest.mark.parametrize(("function", "timeout"), [("hold", 1.0), (":hold", 1.0), ("a:b", 0.0)])
def test_what_cannot_be_called_is_refused(function, timeout):
    with pytest.raises(DenseVSError, match="expected"):
        Hold(function, timeout=timeout)
