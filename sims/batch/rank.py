"""Processes that share the worlds of a batch, one a GPU. Worlds are independent, so they never wait for each other."""

import multiprocessing
import os
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from dense_vs.checks import check_whole
from dense_vs.errors import DenseVSError

MOST_RANKS = 1024


@dataclass(frozen=True)
class Rank:
    """One of several processes.

    Attributes:
        number: from 0.
        count: of the processes in all.
        local: number among those on this machine, which is the number of its GPU.
    """

    number: int = 0
    count: int = 1
    local: int = 0

    def __post_init__(self):
        check_whole("the number of ranks", self.count, least=1, most=MOST_RANKS)
        check_whole("rank", self.number, least=0, most=self.count - 1)
        check_whole("local rank", self.local, least=0)

    @classmethod
    def from_environment(cls) -> "Rank":
        """By ``RANK``, ``WORLD_SIZE`` and ``LOCAL_RANK``, as ``torchrun`` and others set them; without them, alone.

        Raises:
            DenseVSError: one is no whole number, or the rank is none of the count.
        """
        number = _variable("RANK", 0)
        return cls(number, _variable("WORLD_SIZE", 1), _variable("LOCAL_RANK", number))

    def share(self, worlds: int) -> range:
        """Numbers of the worlds that this process computes.

        Raises:
            DenseVSError: fewer worlds than processes.
        """
        if worlds < self.count:
            raise DenseVSError(f"worlds is {worlds}; expected at least one for each of the {self.count} processes")
        return range(worlds * self.number // self.count, worlds * (self.number + 1) // self.count)

    def device(self, device: str) -> str:
        """This process's own GPU where ``device`` is ``"auto"`` or ``"cuda"`` and there is one; else ``device``."""
        import warp as wp

        wp.init()
        if self.count == 1 or device not in ("auto", "cuda") or not wp.is_cuda_available():
            return device
        return f"cuda:{self.local % len(wp.get_cuda_devices())}"


def _variable(name: str, default: int) -> int:
    text = os.environ.get(name, "").strip()
    if not text:
        return default
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise DenseVSError(f"{name} is {text!r}; expected a whole number of at least 0")
    return int(text)


def run_ranks(work: Callable[..., Any], count: int, arguments: tuple[Any, ...]) -> list[Any]:
    """``work(rank, *arguments)`` in that many processes of this machine at once; their results in order.

    Args:
        work: a function of a module.
        count: of processes.
        arguments: that a process can be given, barriers among them.

    Raises:
        DenseVSError: a process failed or was killed; the others are ended.
    """
    from dense_vs.kernels.launch import available_cores

    Rank(0, count)  # refuses counts that are none
    context = multiprocessing.get_context("spawn")  # a fork would share the parent's CUDA context
    threads = str(max(1, available_cores() // count))
    pipes, processes = [], []
    try:
        for number in range(count):
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(
                target=_answer, args=(theirs, Rank(number, count, number), threads, work, arguments), daemon=True
            )
            process.start()
            theirs.close()  # so that its end is seen when the process ends
            pipes.append(ours)
            processes.append(process)
        return _answers(pipes)
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


def _answers(pipes: list[Connection]) -> list[Any]:
    found: dict[int, Any] = {}
    while len(found) < len(pipes):
        for pipe in wait([pipe for number, pipe in enumerate(pipes) if number not in found]):
            number = pipes.index(pipe)  # pyright: ignore[reportArgumentType]
            try:
                fine, found[number] = pipes[number].recv()
            except EOFError:
                raise DenseVSError(f"process {number} of {len(pipes)} ended without a result") from None
            if not fine:
                raise DenseVSError(f"process {number} of {len(pipes)} failed: {found[number]}")
    return [found[number] for number in range(len(pipes))]


def _answer(pipe: Connection, rank: Rank, threads: str, work: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    from dense_vs.device import one_blas_thread

    os.environ.setdefault("DENSE_VS_THREADS", threads)
    try:
        with one_blas_thread():  # processes beside each other
            result = work(rank, *arguments)
        pipe.send((True, result))
    except Exception as error:
        pipe.send((False, f"{type(error).__name__}: {error}"))
