"""A batch run from its case to its results: in this process, in one a GPU, or as one of several that others started.

Every process leaves its worlds' results in the folder, and on the way what it takes to go on after an interruption.
Another number of processes may go on: worlds have numbers, and what a world does depends on its number alone.
"""

import time
from pathlib import Path

import warp as wp

from dense_vs.checks import check_whole
from dense_vs.device import resolve_device
from dense_vs.errors import DenseVSError
from dense_vs.sims.batch.batch_state import restore_worlds, stored_worlds
from dense_vs.sims.batch.case import BatchCase
from dense_vs.sims.batch.episode import BatchResults
from dense_vs.sims.batch.parts import CHECKPOINT, RESULTS, read_worlds, result_arrays, results_of, write_part
from dense_vs.sims.batch.rank import Rank, run_ranks

CHECK_FRAMES = 30  # between looks at whether all worlds rest
POLL_SECONDS = 0.2


def run_case(
    case: BatchCase,
    folder: Path,
    *,
    processes: int = 1,
    device: str = "auto",
    threads: int | None = None,
    checkpoint_frames: int = 0,
) -> BatchResults:
    """Run a case to its end, from where the folder's files leave off.

    Args:
        case: the worlds and their course.
        folder: for results and checkpoints.
        processes: on this machine; several take a GPU each where ``device`` is ``"auto"`` or ``"cuda"``.
        device, threads: of each process.
        checkpoint_frames: frames between two checkpoints, 0 for none; of order 1 and 4 joints a world takes 2.6 MB.

    Raises:
        DenseVSError: a process failed or was killed; files of another case.
    """
    options = (case, folder, device, threads, check_whole("checkpoint_frames", checkpoint_frames, least=0))
    Rank(0, processes).share(case.worlds)
    if processes == 1:
        run_share(Rank(), *options)
    else:
        run_ranks(run_share, processes, options)
    return gather(case, folder, seconds=0.0)


def run_share(
    rank: Rank, case: BatchCase, folder: Path, device: str, threads: int | None, checkpoint_frames: int
) -> int:
    """Run this process's worlds to their end and store their results; how many frames that took here."""
    share = rank.share(case.worlds)
    if read_worlds(folder, RESULTS, case, share) is not None:
        return 0
    stored = read_worlds(folder, CHECKPOINT, case, share)
    if rank.count > 1:
        wp.set_device(resolve_device(rank.device(device)))
    batch = case.batch(rank, device, threads)
    if stored is not None:
        restore_worlds(batch, stored)
    begun = batch.frames
    while batch.frames < batch.longest_run and not batch.resting.all():
        until = CHECK_FRAMES - batch.frames % CHECK_FRAMES
        if checkpoint_frames:
            until = min(until, checkpoint_frames - batch.frames % checkpoint_frames)
        batch.run(until)
        if checkpoint_frames and batch.frames % checkpoint_frames == 0:
            write_part(folder, CHECKPOINT, case, share.start, stored_worlds(batch))
    write_part(folder, RESULTS, case, share.start, result_arrays(batch.results(), batch.frames))
    return batch.frames - begun


def gather(case: BatchCase, folder: Path, *, seconds: float) -> BatchResults:
    """Results of all worlds; waits that long for those that other processes still compute.

    Raises:
        DenseVSError: some are still missing.
    """
    end = time.monotonic() + seconds
    while True:
        arrays = read_worlds(folder, RESULTS, case, range(case.worlds))
        if arrays is not None:
            return results_of(arrays)
        if time.monotonic() >= end:
            raise DenseVSError(
                f"{folder} lacks results of some of the {case.worlds} worlds after {seconds:g} s; "
                "expected those of every process"
            )
        time.sleep(POLL_SECONDS)
