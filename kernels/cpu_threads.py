"""A CPU's threads, which share out launches that were recorded before.

A whole image takes a few tenths of a millisecond, so handing work over has to take far less: one queue in C that idle
threads wait at, and two locks a call. Python's own pool took a third of such a launch.
"""

from _thread import allocate_lock
from collections.abc import Callable, Iterator, Sequence
from queue import SimpleQueue
from threading import Lock, Thread


class _Help:
    """What one thread is asked for: to call functions of an iterator that others call as well, until none is left."""

    __slots__ = ("_begun", "_calls", "_done", "_error")

    def __init__(self, calls: Iterator[Callable[[], None]]):
        self._calls = calls
        self._begun, self._done = allocate_lock(), allocate_lock()
        self._done.acquire()
        self._error: BaseException | None = None

    def give(self) -> None:
        """Called by a thread that has come to it; nothing where it came too late."""
        if not self._begun.acquire(blocking=False):
            return
        try:
            for call in self._calls:
                call()
        except BaseException as error:
            self._error = error
        finally:
            self._done.release()

    def end(self) -> None:
        """Wait until what has begun is done; what has not begun by now does not begin any more."""
        if self._begun.acquire(blocking=False):
            return
        self._done.acquire()
        if self._error is not None:
            raise self._error


_WAITING: SimpleQueue[_Help] = SimpleQueue()
_THREADS: list[Thread] = []
_STARTING = Lock()


def share_out(calls: Sequence[Callable[[], None]], threads: int) -> None:
    """Call functions that do not depend on each other on so many threads, this one among them.

    Each is handed out once, to whichever thread asks: one whose core is busy elsewhere asks less often.
    """
    waiting = iter(calls)
    helpers = max(min(threads, len(calls)) - 1, 0)
    if helpers > len(_THREADS):
        _start(helpers)
    helps = [_Help(waiting) for _ in range(helpers)]
    for help_ in helps:
        _WAITING.put(help_)
    try:
        for call in waiting:
            call()
    finally:
        for help_ in helps:
            help_.end()


def _start(count: int) -> None:
    """Have at least so many threads that wait for something to do."""
    with _STARTING:
        while len(_THREADS) < count:
            thread = Thread(target=_work, name=f"dense-vs_{len(_THREADS)}", daemon=True)
            thread.start()
            _THREADS.append(thread)


def _work() -> None:
    while True:
        _WAITING.get().give()
