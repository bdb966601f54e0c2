"""Trials: a mutation in place of its module, and the tests that are asked about it, each in a process of its own.

Known tools start a program a mutation, which here is five seconds of imports each; this one imports the libraries once
and forks. Kernel bodies are left out, as Warp reads their source from the file.
"""

import importlib.abc
import importlib.util
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

from mutation.operators import Mutant
from mutation.shares import keep_to_share

PATIENCE = 4.0  # times as long until a mutation that hangs is stopped; it counts as noticed
GRACE = 30.0  # seconds beside it, for imports
FAILED = (1, 2, 4)  # pytest's codes where tests failed, or could not be imported; an asked test is known to exist


@dataclass(frozen=True)
class Trial:
    """One mutation and its tests.

    Attributes:
        group, file: where it belongs.
        mutant: the mutation; None for a control, which leaves the module as it is and must pass.
        tests: that are asked.
        seconds: that they may take without a mutation.
    """

    group: str
    file: str
    mutant: Mutant | None
    tests: list[str]
    seconds: float


@dataclass(frozen=True)
class _Running:
    trial: Trial
    slot: int
    end: float


def run_trials(
    trials: Iterable[Trial], root: Path, work: Path, jobs: int, seconds: float
) -> Iterator[tuple[Trial, str]]:
    """Each trial with its outcome as it comes: ``killed``, ``timeout`` (which counts as killed) or ``survived``.

    What still runs after ``seconds`` is stopped and has no outcome.
    """
    end = time.monotonic() + seconds
    waiting = iter(trials)
    free = list(range(jobs))
    running: dict[int, _Running] = {}
    try:
        while time.monotonic() < end:
            while free and (trial := next(waiting, None)) is not None:
                if not trial.tests:
                    yield trial, "survived"
                    continue
                slot = free.pop()
                child = _start(trial, root, work / f"trial-{slot}", slot, jobs)
                running[child] = _Running(trial, slot, time.monotonic() + GRACE + PATIENCE * trial.seconds)
            if not running:
                return
            for child, one in list(running.items()):
                outcome = _outcome(child, one.end)
                if outcome is not None:
                    del running[child]
                    free.append(one.slot)
                    yield one.trial, outcome
            time.sleep(0.02)
    finally:
        for child in running:
            _stop(child)
        for slot in range(jobs):
            shutil.rmtree(work / f"trial-{slot}", ignore_errors=True)


def _start(trial: Trial, root: Path, scratch: Path, slot: int, jobs: int) -> int:
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 3
        try:
            os.setsid()
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            keep_to_share(slot, jobs)
            code = _in_child(trial, root, scratch)
        finally:
            os._exit(code)
    return child


def _outcome(child: int, end: float) -> str | None:
    done, status = os.waitpid(child, os.WNOHANG)
    if done:
        code = os.waitstatus_to_exitcode(status)
        # A crash counts; what pytest calls an error of its own does not tell anything about the mutation.
        return "survived" if code == 0 else "killed" if code in FAILED or code < 0 else "error"
    if time.monotonic() > end:
        _stop(child)
        return "timeout"
    return None


def _stop(child: int) -> None:
    try:
        os.killpg(child, signal.SIGKILL)
    except ProcessLookupError:  # it has not yet got a group of its own
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def _in_child(trial: Trial, root: Path, scratch: Path) -> int:
    null = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(null, number)
    if trial.mutant is not None:
        sys.meta_path.insert(0, _Mutated(root / trial.file, trial.mutant))
    import pytest

    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:cov", f"--basetemp={scratch}"]
    return int(pytest.main([*options, *trial.tests]))


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Gives the mutated module wherever its file would be imported from."""

    def __init__(self, path: Path, mutant: Mutant):
        self._path = path.resolve()
        self._mutant = mutant

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        for finder in sys.meta_path:
            if finder is self or not hasattr(finder, "find_spec"):
                continue
            spec = finder.find_spec(fullname, path, target)
            if spec is None:
                continue
            if spec.origin is None or Path(spec.origin).name != self._path.name:
                return spec
            if Path(spec.origin).resolve() != self._path:
                return spec
            package = spec.submodule_search_locations
            spec = importlib.util.spec_from_file_location(fullname, spec.origin, loader=self)
            if spec is not None:
                spec.submodule_search_locations = package
            return spec
        return None

    def get_source(self, fullname: str) -> str:
        return self._path.read_text(encoding="utf-8")

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._mutant.mutated(self.get_source(fullname)), str(self._path), "exec")

    def is_package(self, fullname: str) -> bool:
        return self._path.name == "__init__.py"
