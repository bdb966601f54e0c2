"""Whether a live server grows while pages come and go: memory, threads and open files, minute by minute.

    python profiling/live_growth.py [--minutes 30] [--robot arm] [--json profiling/results/live_growth.json]

The server of ``dense-vs live`` runs the simulated robot. Visit after visit, a page learns, clicks the robot's tip, lets
it go to targets, records now and then, and leaves while the robot moves; others look on, one of them without ever
reading, and one is killed. Every fourth visit J and the body are forgotten first. The process apart that knows the body
is watched too. What counts as growth is said in ``growth.py``; the exit code is 1 where there is any.
"""

import argparse
import itertools
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import warp as wp
from growth import growth
from metrics import Metric, add_report_arguments, report

from dense_vs.live.access import Access
from dense_vs.live.mode import Mode
from dense_vs.live.options import LiveOptions
from dense_vs.live.server import make_app, make_server
from dense_vs.live.session import LiveSession
from dense_vs.live.source import LiveSource
from dense_vs.sims import SimCamera, SimRobot, SimWorld
from dense_vs.view.provenance import commit

HERE = Path(__file__).parent
POINT = "tip"  # of the robot, that visitors click
VISIT = 40.0  # s
FIRST = 5.0  # s after which others come; the first page has control
LOOKERS = (0, 2, 4, 1)  # pages that look on, visit by visit
# What is counted, and how the log says it.
COUNTED = {"bodies": "body learned", "arrivals": ": reached", "recordings": "recorded", "stops": "stopped"}
RISES = {"memory_mb": 20.0, "body_memory_mb": 20.0, "threads": 1.0, "files": 2.0}  # allowed over the judged time


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="how long it runs (default: 30)")
    parser.add_argument("--period", type=float, default=60.0, help="seconds between samples (default: 60)")
    parser.add_argument("--robot", default="arm", help="simulated robot with a point named tip (default: arm)")
    parser.add_argument("--seed", type=int, default=0)
    add_report_arguments(parser)
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    began = commit()  # of what runs, though the files may change meanwhile
    samples = measured(options)
    metrics, grown = judged(samples)
    code = report(metrics, options, commit=began, samples=samples)
    for name in grown:
        print(f"{name} grows", file=sys.stderr)
    return 1 if grown else code


def judged(samples: list[dict[str, float]]) -> tuple[list[Metric], list[str]]:
    """Level and rise of every figure, and the names of those that grow."""
    metrics, grown = [], []
    minutes = [sample["minute"] for sample in samples]
    for name, allowed in RISES.items():
        found = growth(minutes, [sample[name] for sample in samples], allowed)
        unit = "MB" if name.endswith("mb") else "1"
        metrics.append(Metric(name, found.level, unit, "lower", 0.2))
        metrics.append(Metric(f"{name}_rise", found.rise, unit, "lower", 0.2))
        grown += [name] if found.grows else []
    metrics += [Metric(name, samples[-1][name], "1", "higher", 0.2) for name in ("visits", "frames", *COUNTED)]
    metrics.append(Metric("grown", len(grown), "1", "lower", 0.0))
    return metrics, grown


def measured(options: argparse.Namespace) -> list[dict[str, float]]:
    """Samples of a run."""
    world = SimWorld(options.robot, seed=options.seed, height=240, width=320)
    source = LiveSource(SimCamera(world), SimRobot(world), f"simulated {options.robot}", paced=False)
    samples: list[dict[str, float]] = []
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as folder:
        session = LiveSession(source, LiveOptions(folder=Path(folder), stall_seconds=5.0))
        listening = socket.create_server(("127.0.0.1", 0))
        server = make_server(make_app(session, Access("127.0.0.1")), "127.0.0.1", 0)
        serving = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        visits = Visits(session, world, f"127.0.0.1:{listening.getsockname()[1]}", Path(folder), options.seed)
        visiting = threading.Thread(target=visits.run, args=(ended,), daemon=True)
        session.start()
        serving.start()
        try:
            while session.mode is Mode.STARTING:
                time.sleep(0.1)
            visiting.start()
            begin = time.monotonic()
            while (minute := (time.monotonic() - begin) / 60) < options.minutes:
                samples.append({"minute": round(minute, 3), **figures(), **visits.told()})
                print(json.dumps(samples[-1]), flush=True)
                time.sleep(options.period)
        finally:
            ended.set()
            visiting.join(timeout=VISIT + 60)
            server.should_exit = True
            serving.join(timeout=10)
            session.end()
            listening.close()
    return samples


class Visits:
    """Pages that come and go.

    Args:
        session, world: what they look at, and where its tip is.
        address: of the server.
        folder: that recordings go to; emptied after every visit.
        seed: of what they do.
    """

    def __init__(self, session: LiveSession, world: SimWorld, address: str, folder: Path, seed: int):
        self._session, self._world, self._address = session, world, address
        self._folder, self._seed, self._count = folder, seed, 0
        self._line, self._counts = 0, dict.fromkeys(COUNTED, 0.0)

    def told(self) -> dict[str, float]:
        """How far they are, and how often the log has said what."""
        lines = self._session.board.lines(self._line)
        if lines:
            self._line = lines[-1]["number"]
        for name, words in COUNTED.items():
            self._counts[name] += sum(words in line["text"] for line in lines)
        return {"visits": float(self._count), "frames": float(self._session.number), **self._counts}

    def run(self, ended: threading.Event) -> None:
        """Visit until it is over."""
        for lookers in itertools.cycle(LOOKERS):
            if ended.is_set():
                return
            self._visit(lookers)
            self._count += 1

    def _visit(self, lookers: int) -> None:
        steer = [sys.executable, str(HERE / "live_visitor.py"), self._address]
        steer += ["--seed", str(self._seed + self._count), "--seconds", str(VISIT)]
        steer += ["--forget"] * (self._count % 4 == 3) + ["--record"] * (self._count % 2)
        look = [sys.executable, str(HERE / "live_clients.py"), self._address, str(lookers), "--seconds", str(VISIT / 2)]
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        asks = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        pages = [subprocess.Popen(steer, **quiet | asks)]
        telling = threading.Thread(target=self._tell_point, args=(pages[0],), daemon=True)
        telling.start()
        if lookers:
            time.sleep(FIRST)
            pages.append(subprocess.Popen([*look, "--stalled"], **quiet))
            killed = subprocess.Popen(look, **quiet)
            time.sleep(VISIT / 4)
            killed.kill()
            killed.wait()
        for page in pages:
            page.wait(timeout=VISIT + 60)
        telling.join(timeout=5)
        recording = self._session.last_recording
        if recording is not None and recording.done.wait(10):
            for file in self._folder.rglob("*"):
                file.unlink() if file.is_file() else None

    def _tell_point(self, page: subprocess.Popen[str]) -> None:
        """Tell a page where the tip is, once it asks."""
        assert page.stdin is not None
        assert page.stdout is not None
        with page.stdin, page.stdout:
            if page.stdout.readline():
                x, y = self._world.project(POINT)
                page.stdin.write(f"{x:.2f},{y:.2f}\n")


def figures() -> dict[str, float]:
    """Memory [MB], threads and open files of this process, and memory of the body's."""
    own = Path("/proc/self")
    body = [pid for pid in children() if b"body_worker" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    return {
        "memory_mb": resident(own),
        "body_memory_mb": sum(resident(Path(f"/proc/{pid}")) for pid in body),
        "threads": float(len(os.listdir(own / "task"))),
        "files": float(len(os.listdir(own / "fd"))),
    }


def children() -> list[str]:
    """Processes that this one started."""
    found = []
    for task in Path("/proc/self/task").iterdir():
        found += (task / "children").read_text().split()
    return found


def resident(process: Path) -> float:
    """Memory of a process [MB], as Linux tells it."""
    return int((process / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    raise SystemExit(main())
