"""Where tasks run: processes of this machine, or a Ray cluster."""

import os
import socket
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from dense_vs.errors import DenseVSError
from dense_vs.sweep.run_task import run_task
from dense_vs.sweep.task import Outcome, Task

RETRIES = 3  # of a task whose worker or machine was lost


def run_locally(tasks: Sequence[Task], folder: Path, version: str, jobs: int, threads: int) -> Iterator[Outcome]:
    """Outcomes as tasks end, ``jobs`` at a time; the threads only wait for the processes of the tasks."""
    pool = ThreadPoolExecutor(jobs, thread_name_prefix="sweep")
    try:
        pending = {pool.submit(run_task, task, folder, version, threads) for task in tasks}
        while pending:
            ended, pending = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in ended)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def run_by_ray(tasks: Sequence[Task], folder: Path, version: str, address: str, threads: int) -> Iterator[Outcome]:
    """Outcomes as tasks end on a Ray cluster; a task whose worker or machine is lost runs again elsewhere.

    Args:
        tasks: what to run.
        folder: of the sweep, on a disk that every machine of the cluster sees.
        version: of the code.
        address: ``"local"`` starts a cluster on this machine, ``"auto"`` joins the one that runs here and starts one
            where none does, ``"ray://HOST:PORT"`` or ``"HOST:PORT"`` joins that one.
        threads: CPU threads a task, which it reserves as CPUs of the cluster.
    """
    ray = _connect(address)
    try:
        remote = ray.remote(num_cpus=threads, max_retries=RETRIES)(run_task)
        pending = {remote.remote(task, folder, version, threads): task for task in tasks}
        while pending:
            ended, _ = ray.wait(list(pending), num_returns=1, timeout=1.0)
            for reference in ended:
                task = pending.pop(reference)
                try:
                    yield ray.get(reference)
                except ray.exceptions.RayError as error:
                    reason = " ".join(str(error).split())[:300]
                    yield Outcome(task, f"lost {RETRIES + 1} times: {reason}", "", 0.0)
    finally:
        ray.shutdown()


def _connect(address: str) -> Any:
    try:
        import ray
    except ImportError as error:
        raise DenseVSError("--address needs Ray, which is not installed; pip install 'dense-vs[cluster]'") from error
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # a task without a GPU keeps what it sees
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    quiet: dict[str, Any] = {"logging_level": "ERROR", "log_to_driver": False}
    if address not in ("auto", "local"):
        _check_answers(address)
    try:
        if address == "auto":
            try:
                ray.init("auto", **quiet)
            except ConnectionError:
                ray.init("local", include_dashboard=False, **quiet)
        else:
            own = {"include_dashboard": False} if address == "local" else {}
            ray.init(address, **own, **quiet)
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        raise DenseVSError(
            f"cannot reach a Ray cluster at {address!r}: {' '.join(str(error).split())[:300]}"
        ) from error
    return ray


def _check_answers(address: str) -> None:
    """See that somebody listens there: Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise DenseVSError(f"--address is {address!r}; expected auto, local, HOST:PORT or ray://HOST:PORT")
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except OSError as error:
        raise DenseVSError(f"cannot reach a Ray cluster at {address!r}: {error.strerror or error}") from error
