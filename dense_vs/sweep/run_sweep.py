"""Runs what is missing of a sweep and says how each run ended."""

import fcntl
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from dense_vs.checks import check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import output_folder
from dense_vs.kernels.launch import available_cores
from dense_vs.sweep.executors import run_by_ray, run_locally
from dense_vs.sweep.run_task import RUNNING, is_done, result_folder
from dense_vs.sweep.source_version import source_version
from dense_vs.sweep.task import Outcome, Task
from dense_vs.view.progress import progress


def run_sweep(
    tasks: Sequence[Task],
    folder: Path,
    *,
    jobs: int = 1,
    address: str | None = None,
    threads: int | None = None,
    failures_at_once: bool = True,
) -> list[Outcome]:
    """Run the tasks whose results are not in ``folder`` yet.

    Args:
        tasks: what to run; names differ.
        folder: for results; what an earlier sweep by the same code left there is not run again.
        jobs: processes at once on this machine; ignored with an address.
        address: of a Ray cluster (see :func:`~dense_vs.sweep.executors.run_by_ray`); None runs on this machine.
        threads: CPU threads a task; the cores are shared out between the jobs unless given, and 1 on a cluster.
        failures_at_once: say of a failure when it happens.

    Returns:
        One outcome a task, in the order of the tasks.

    Raises:
        DenseVSError: jobs or threads that are no whole numbers of at least 1, the folder cannot be written, another
            sweep runs in it, or the cluster cannot be reached.
    """
    jobs = check_whole("jobs", jobs, least=1)
    threads = None if threads is None else check_whole("threads", threads, least=1)
    folder, version = output_folder(folder).resolve(), source_version()
    with _alone(folder):
        shutil.rmtree(folder / RUNNING, ignore_errors=True)  # attempts that were killed
        ended = {
            task.name: Outcome(task, "", str(result_folder(folder, task)), 0.0)
            for task in tasks
            if is_done(folder, task, version)
        }
        missing = [task for task in tasks if task.name not in ended]
        if address is None:
            share = threads or max(1, available_cores() // jobs)
            outcomes = run_locally(missing, folder, version, jobs, share)
        else:
            outcomes = run_by_ray(missing, folder, version, address, threads or 1)
        with progress("sweep", len(tasks), unit="task") as bar:
            bar.update(len(ended))
            failed = 0
            for outcome in outcomes if missing else ():
                ended[outcome.task.name] = outcome
                failed += bool(outcome.failure)
                bar.set_description(f"sweep, {failed} failed" if failed else "sweep")
                bar.update()
                if outcome.failure and failures_at_once:
                    print(f"failed: {' '.join(outcome.task.arguments)}: {outcome.failure}", flush=True)
        with suppress(OSError):
            (folder / RUNNING).rmdir()
    return [ended[task.name] for task in tasks]


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, which the system frees when this process ends, however it does."""
    try:
        stream = open(folder / ".lock", "w", encoding="utf-8")  # noqa: SIM115 - closed below, with the lock
    except OSError as error:
        raise DenseVSError(f"cannot write in {folder}: {error.strerror or error}") from error
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise DenseVSError(f"another sweep runs in {folder}; expected one at a time") from error
        yield
