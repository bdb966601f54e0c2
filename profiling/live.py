"""From an image's arrival to the command that follows from it, while 0, 1 and 5 pages look on, one of them stalled.

    python profiling/live.py [--sizes 320x240,640x480] [--seconds 10] [--json FILE]

The camera plays frames of the simulated arm, rendered beforehand, at 30 a second, forward and backward; the session,
its server and its threads are those of ``dense-vs live``. Pages are a process of their own, as browsers are. A point is
tracked and servoed all the time.
"""

import argparse
import itertools
import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import warp as wp
from metrics import Metric, add_report_arguments, report
from recorded_frames import Recording, image_size, record

from dense_vs.live.access import Access
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.server import make_app, make_server
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource

FPS = 30.0
FRAMES = 90
CASES = ((0, False), (1, False), (5, True))
CLIENTS = Path(__file__).with_name("live_clients.py")


class PlayedRobot:
    """Camera and robot that play a recording forward and backward, and note when images came and commands went."""

    def __init__(self, recording: Recording):
        count = len(recording.rgb)
        self._recording = recording
        self._order = itertools.cycle([*range(count), *range(count - 2, 0, -1)])
        self._now = next(self._order)
        self._time = 0.0
        self._due = time.monotonic()
        self._came: float | None = None
        self.joint_names, self.joint_limits = recording.joint_names, recording.joint_limits
        self.latencies: list[float] = []

    def read(self) -> tuple[np.ndarray, float]:
        """The next image at its time [s]."""
        self._now = next(self._order)
        self._time += 1 / FPS
        self._due = max(self._due + 1 / FPS, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._came = time.perf_counter()
        return self._recording.rgb[self._now], self._time

    def joints(self) -> tuple[np.ndarray, float]:
        """Joint positions ``(N,)`` of the last image."""
        return self._recording.positions[self._now], self._time

    def command(self, delta: np.ndarray) -> None:
        """Note when a command came."""
        if self._came is not None:
            self.latencies.append(time.perf_counter() - self._came)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="320x240,640x480", metavar="WxH,...")
    parser.add_argument("--robot", default="arm")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each case (default: 10)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int)
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    metrics = []
    for size in options.sizes.split(","):
        width, height = image_size(size)
        recording = record(options.robot, height, width, frames=FRAMES, seed=options.seed)
        metrics += measured(size, recording, options)
    return report(metrics, options)


def measured(size: str, recording: Recording, options: argparse.Namespace) -> list[Metric]:
    """All cases of one image size."""
    robot = PlayedRobot(recording)
    session = LiveSession(LiveSource(robot, robot, "played"), LiveOptions(threads=options.threads))
    listening = socket.create_server(("127.0.0.1", 0))
    server = make_server(make_app(session, Access("127.0.0.1")), "127.0.0.1", 0)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    session.start()
    thread.start()
    address = f"127.0.0.1:{listening.getsockname()[1]}"
    metrics: list[Metric] = []
    try:
        servo(session)
        for count, stalled in CASES:
            metrics += case(size, robot, session, (address, count, stalled), options.seconds)
    finally:
        server.should_exit = True
        thread.join(timeout=10)
        session.end()
        listening.close()
    return metrics


def servo(session: LiveSession) -> None:
    """Let J be learned for a moment from what is played, then track and servo a point for good."""
    wait(lambda: session.mode is Mode.STILL)
    session.ask(lambda: session.begin_mode(Mode.LEARNING))
    wait(lambda: session.running_loop().estimator.updates > 120)
    width, height = session.running_loop().estimator.options.width, session.running_loop().estimator.options.height
    place = np.array([0.1 * width, 0.2 * height])  # of the wall: it is never lost, and costs what any point does

    def begin() -> None:
        session.be_still("to begin with")
        session.points.add(place, session.frames_since(1 << 40), session.running_loop().pipeline)
        session.points.aim(1, place + 20)
        session.begin_mode(Mode.REACHING)

    session.ask(begin)
    wait(lambda: session.mode is Mode.REACHING)


def case(
    size: str, robot: PlayedRobot, session: LiveSession, pages: tuple[str, int, bool], seconds: float
) -> list[Metric]:
    """Latency and rates with some pages."""
    address, count, stalled = pages
    words = [sys.executable, str(CLIENTS), address, str(count), "--seconds", str(seconds + 2)]
    clients = subprocess.Popen([*words, *(["--stalled"] if stalled else [])], stdout=subprocess.PIPE, text=True)
    time.sleep(2.0)  # they have connected
    # A page that goes stops the robot, which is right; here it is to go on.
    session.ask(lambda: session.begin_mode(Mode.REACHING))
    time.sleep(0.2)
    robot.latencies.clear()
    time.sleep(seconds - 1.0)
    latencies = 1e3 * np.array(robot.latencies)
    frames = len(latencies) / (seconds - 1.0)
    told, _ = clients.communicate(timeout=60)
    rates = [rate for rate in json.loads(told) if rate > 0]
    name = f"{count}_pages_{size}" if count != 1 else f"1_page_{size}"
    found = [
        Metric(f"latency_ms_{name}", float(np.median(latencies)), "ms", "lower", 0.2),
        Metric(f"latency_p95_ms_{name}", float(np.quantile(latencies, 0.95)), "ms", "lower", 0.3),
        Metric(f"loop_fps_{name}", frames, "fps", "higher", 0.1),
    ]
    if rates:
        found.append(Metric(f"page_fps_{name}", float(np.mean(rates)), "fps", "higher", 0.2))
    return found


def wait(condition, seconds: float = 120.0) -> None:
    """Wait for a condition; an error where it does not come."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise SystemExit("the session did not get so far")
        time.sleep(0.05)


if __name__ == "__main__":
    raise SystemExit(main())
