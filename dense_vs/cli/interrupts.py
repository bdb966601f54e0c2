"""Requests to stop (SIGINT, SIGTERM), asked again where one is lost on its way.

Python answers such a request by an exception, which is lost where code discards it: callbacks of weak references do,
and so do compiled modules that import others while they are imported. Nothing of that can be seen where it happens. A
thread therefore watches whether the exception is still under way, and asks again if it is not.
"""

import os
import signal
import sys
import threading

LOST = 0.5  # s; so long nothing may be seen of an exception that is on its way
LOOK = 0.05  # s between two looks


class Interrupts:
    """Raises ``KeyboardInterrupt`` in the main thread when the process is asked to stop, until it is answered."""

    def __init__(self) -> None:
        self.asked: list[int] = []  # numbers of the signals
        self._answered = threading.Event()
        self._reader, self._writer = os.pipe()  # a handler may write to it, while whom it interrupts may hold any lock

    def take(self) -> None:
        """Take the signals over from the system; to be called in the main thread."""
        main_thread = threading.get_ident()
        threading.Thread(target=self._watch, args=(main_thread,), name="interrupts", daemon=True).start()
        sys.unraisablehook = self._discarded
        signal.signal(signal.SIGINT, self._stop)
        signal.signal(signal.SIGTERM, self._stop)

    def leave(self) -> None:
        """Leave them to the system again: what was asked has been answered."""
        self._answered.set()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)

    def _stop(self, number: int, _: object) -> None:
        self.asked.append(number)
        os.write(self._writer, b"!")
        raise KeyboardInterrupt

    def _discarded(self, error: "sys.UnraisableHookArgs") -> None:
        """Say nothing of a request that Python discards; the watch sees it too."""
        if not (self.asked and isinstance(error.exc_value, KeyboardInterrupt)):
            sys.__unraisablehook__(error)

    def _watch(self, main_thread: int) -> None:
        os.read(self._reader, 1)
        unseen = 0.0
        while not self._answered.wait(LOOK):
            unseen = 0.0 if _under_way(main_thread) else unseen + LOOK
            if unseen >= LOST:
                unseen = 0.0
                signal.pthread_kill(main_thread, self.asked[-1])


def by_interrupt(error: BaseException) -> bool:
    """Whether an interrupt stands behind an error: Python wraps one that comes while a class is being made."""
    cause = error.__cause__ or error.__context__
    return isinstance(error, KeyboardInterrupt) or (cause is not None and by_interrupt(cause))


def _under_way(thread: int) -> bool:
    """Whether a thread handles an interrupt, or closes a generator that one has left."""
    handled = sys._current_exceptions().get(thread)
    error = handled[1] if isinstance(handled, tuple) else handled  # the exception itself from Python 3.12 on
    return error is not None and (isinstance(error, GeneratorExit) or by_interrupt(error))
