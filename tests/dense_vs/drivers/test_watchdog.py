"""The watchdog: a loop that is killed leaves a robot that was told to hold, one that ends as it should does not."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from dense_vs.drivers import watchdog
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


@pytest.fixture
def pipe():
    """Both ends of a pipe; the writing one may be closed by a test."""
    ends = os.pipe()
    yield ends
    for end in ends:
        with suppress(OSError):
            os.close(end)


@pytest.mark.parametrize(
    ("beats", "ends", "why"),
    [
        (b"", True, "gone"),  # before the first frame
        (b".", True, "gone"),
        (b"...", True, "gone"),
        (b".", False, "silent"),
        (b"..", False, "silent"),
        (b"q", False, "goodbye"),
        (b"q", True, "goodbye"),
        (b"..q", False, "goodbye"),
        (b"..q", True, "goodbye"),  # which it said, though the end has come as well
    ],
)
def test_what_a_pipe_says_of_the_loop(pipe, beats, ends, why):
    os.write(pipe[1], beats)
    if ends:
        os.close(pipe[1])
    assert watchdog.watch(pipe[0], 0.02) == why


def test_the_first_frame_may_take_as_long_as_kernels_compile(monkeypatch):
    """Only what comes after it is waited for so long and no longer."""
    given, waited = [b".", b"..", b""], []
    monkeypatch.setattr(watchdog.os, "read", lambda stream, count: given.pop(0))

    def select(streams, written, failed, timeout):
        waited.append((streams, timeout))
        return streams, [], []

    monkeypatch.setattr(watchdog.select, "select", select)
    assert watchdog.watch(7, 0.25) == "gone"
    assert waited == [([7], 0.25)] * 2


@pytest.fixture
def tries(monkeypatch):
    """A bus that is free after so many tries, and the pauses between them."""
    pauses, done = [], []
    monkeypatch.setattr(watchdog.time, "sleep", pauses.append)

    def make(free_after):
        def hold(**arguments):
            done.append(arguments)
            if len(done) <= free_after:
                raise OSError("the bus is busy")

        return hold

    return SimpleNamespace(make=make, pauses=pauses, done=done)


@pytest.mark.parametrize(("free_after", "held"), [(0, True), (3, True), (19, True), (20, False)])
def test_a_bus_is_tried_until_it_is_free(tries, capsys, free_after, held):
    assert watchdog._hold(tries.make(free_after), {"robot": "arm"}) is held
    assert tries.done == [{"robot": "arm"}] * min(free_after + 1, 20)
    assert len(tries.pauses) == free_after
    assert set(tries.pauses) <= {0.1}
    assert ("cannot make the robot hold: the bus is busy" in capsys.readouterr().err) == (not held)


@pytest.mark.parametrize(
    ("said", "free_after", "code", "held"),
    [
        (["goodbye"], 0, 0, 0),
        (["gone"], 0, 0, 1),
        (["gone"], 99, 1, 20),  # in vain
        (["silent", "goodbye"], 0, 0, 1),  # it goes on, and ends as it should
        (["silent", "silent", "gone"], 0, 0, 3),
    ],
)
def test_whoever_is_not_told_goodbye_holds(tries, monkeypatch, capsys, said, free_after, code, held):
    states, asked = list(said), []
    monkeypatch.setattr(watchdog.sys, "stdin", SimpleNamespace(fileno=lambda: 5))
    monkeypatch.setattr(watchdog, "watch", lambda *asked_for: asked.append(asked_for) or states.pop(0))
    monkeypatch.setattr(watchdog, "import_module", lambda name: {"a.bus": SimpleNamespace(hold=hold)}[name])
    hold = tries.make(free_after)
    assert watchdog.main(["a.bus:hold", '{"robot": "arm"}', "0.5"]) == code
    assert tries.done == [{"robot": "arm"}] * held
    assert asked == [(5, 0.5)] * len(said)
    told = capsys.readouterr().err
    for why in said:
        assert (f"the loop is {why}" in told) == (why != "goodbye")
    monkeypatch.setattr(watchdog.sys, "argv", ["watchdog", "a.bus:hold", '{"robot": "arm"}', "0.5"])
    states.append("goodbye")
    assert watchdog.main() == 0
