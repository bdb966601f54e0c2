"""Runs one task beside its place and moves the result there when it is whole."""

import os
import shutil
import subprocess
import sys
import time
import uuid
from contextlib import suppress
from pathlib import Path
from typing import IO

from dense_vs.errors import DenseVSError
from dense_vs.files import read_json, write_json
from dense_vs.sweep.task import Outcome, Task

RESULTS, RUNNING, FAILED = "results", "running", "failed"
TASK_FILE, LOG_FILE, FIGURES_FILE, OUT_FOLDER = "task.json", "output.log", "figures.json", "out"


def result_folder(folder: Path, task: Task) -> Path:
    """Where the result of a task lies once it is done."""
    return folder / RESULTS / task.name


def is_done(folder: Path, task: Task, version: str) -> bool:
    """Whether a whole result of this task by this code is there."""
    try:
        content = read_json(result_folder(folder, task) / TASK_FILE)
    except DenseVSError:
        return False
    return isinstance(content, dict) and content.get("key") == task.key(version)


def run_task(task: Task, folder: Path, version: str, threads: int) -> Outcome:
    """Run a task in a process of its own.

    Its files are written to a folder that only this attempt knows. It becomes the result by one rename: an attempt that
    is killed leaves no result, and of two attempts at the same task the first to end counts.

    Args:
        task: what to run.
        folder: of the whole sweep, on a disk that every machine of it sees.
        version: of the code, which becomes part of the key.
        threads: CPU threads for the process.
    """
    attempt = folder / RUNNING / f"{task.name}-{uuid.uuid4().hex}"
    log = attempt / LOG_FILE
    started = time.perf_counter()
    try:
        attempt.mkdir(parents=True)
        command = task.command_line(str(attempt / OUT_FOLDER), str(attempt / FIGURES_FILE))
        with open(log, "wb") as stream:
            code = _run(command, stream, threads)
        seconds = time.perf_counter() - started
        if code:
            kept = _moved(attempt, folder / FAILED / task.name)
            return Outcome(task, _last_line(kept / LOG_FILE, code), str(kept / LOG_FILE), seconds)
        said = {"key": task.key(version), "version": version, "arguments": list(task.arguments), "seconds": seconds}
        write_json(attempt / TASK_FILE, said)
        if is_done(folder, task, version):
            shutil.rmtree(attempt)
        else:
            _moved(attempt, result_folder(folder, task))
        with suppress(OSError):
            shutil.rmtree(folder / FAILED / task.name)
        return Outcome(task, "", str(result_folder(folder, task) / LOG_FILE), seconds)
    except OSError as error:
        return Outcome(task, f"cannot write {attempt}: {error.strerror or error}", str(log), 0.0)


def _run(command: list[str], stream: IO[bytes], threads: int) -> int:
    environment = {
        **os.environ,
        "DENSE_VS_THREADS": str(threads),
        "OMP_NUM_THREADS": str(threads),
        "OPENBLAS_NUM_THREADS": str(threads),
        "PYTHONUNBUFFERED": "1",
    }
    started = subprocess.Popen(
        [sys.executable, "-m", "dense_vs.sweep.child", *command],
        stdin=subprocess.DEVNULL,
        stdout=stream,
        stderr=subprocess.STDOUT,
        env=environment,
    )
    try:
        return started.wait()
    finally:
        if started.poll() is None:  # this process was told to end
            started.kill()
            started.wait()


def _moved(attempt: Path, place: Path) -> Path:
    """The attempt's folder, renamed; what another attempt left there before goes."""
    place.parent.mkdir(parents=True, exist_ok=True)
    for _ in range(3):
        try:
            attempt.rename(place)
            return place
        except OSError:
            if not place.exists():
                raise
            aside = attempt.parent / f"old-{uuid.uuid4().hex}"
            with suppress(FileNotFoundError):
                place.rename(aside)
            shutil.rmtree(aside, ignore_errors=True)
    attempt.rename(place)
    return place


def _last_line(log: Path, code: int) -> str:
    """Why a process failed: what it said last, else its exit code."""
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    said = next((line.strip() for line in reversed(lines) if line.strip()), "")
    ended = f"ended by signal {-code}" if code < 0 else f"exit code {code}"
    return f"{said[:300]} ({ended})" if said else ended
