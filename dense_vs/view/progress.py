"""Progress of commands and experiments, on standard error: a bar in a terminal, now and then a line elsewhere."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

EVERY = 10.0  # seconds between the lines of a log


class Bar(Protocol):
    """Anything that shows progress."""

    def update(self, steps: int = 1) -> None:
        """So many more steps are done."""
        ...

    def set_description(self, description: str) -> None:
        """Text beside the progress: the step that is done now."""
        ...


@contextmanager
def progress(description: str, total: int | None = None, unit: str = "frame") -> Iterator[Bar]:
    """Show the progress of a block, which calls ``update()`` after every step.

    Args:
        description: what is being done.
        total: number of steps; None or 0 where it is not known. Once more are done, it is not known either.
        unit: what a step is.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        lines = _Lines(description, total or None, _plural(unit))
        yield lines
        lines.end()
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(_plural(unit), markup=False),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as shown:
        yield _Shown(shown, shown.add_task(description, total=total or None))


def _plural(unit: str) -> str:
    return f"{unit[:-1]}ies" if unit.endswith("y") else f"{unit}s"


class _Shown:
    """A bar in a terminal."""

    def __init__(self, shown: Progress, task):
        self._shown, self._task = shown, task

    def update(self, steps: int = 1) -> None:
        self._shown.advance(self._task, steps)
        task = next(task for task in self._shown.tasks if task.id == self._task)
        if task.total is not None and task.completed > task.total:
            task.total = None

    def set_description(self, description: str) -> None:
        self._shown.update(self._task, description=description)


class _Lines:
    """Lines of a log: one every ten seconds, and one at the end."""

    def __init__(self, description: str, total: int | None, units: str):
        self._description, self._total, self._units = description, total, units
        self._done, self._said_done = 0, -1
        self._started = self._said = time.monotonic()

    def update(self, steps: int = 1) -> None:
        self._done += steps
        if self._total is not None and self._done > self._total:
            self._total = None
        if time.monotonic() - self._said >= EVERY:
            self.end()

    def set_description(self, description: str) -> None:
        self._description = description

    def end(self) -> None:
        """Say how far it is, once."""
        if self._done == self._said_done:
            return
        self._said, self._said_done = time.monotonic(), self._done
        done = f"{self._done}" if self._total is None else f"{self._done} of {self._total}"
        # Nobody's work ends because nobody reads the log.
        with suppress(OSError):
            seconds = self._said - self._started
            print(f"{self._description}: {done} {self._units} in {seconds:.1f} s", file=sys.stderr, flush=True)
