"""Clocks around the parts of a running program: an attribute is replaced by a timed one and put back at the end."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np


class StageClock:
    """Adds up seconds per stage and frame.

    Args:
        finish: waits for what a stage has begun, on a device that goes on by itself.
    """

    def __init__(self, finish: Callable[[], None] = lambda: None):
        self._finish = finish
        self._now: dict[str, float] = defaultdict(float)
        self._frames: list[dict[str, float]] = []
        self._restore: list[Callable[[], None]] = []

    @contextmanager
    def installed(self) -> Iterator[None]:
        """While inside, wrapped attributes stay wrapped."""
        try:
            yield
        finally:
            while self._restore:
                self._restore.pop()()

    def wrap(self, owner: Any, name: str, stage: str) -> None:
        """Time every call of ``owner.name``, which may be any callable."""
        own = vars(owner)
        inherited = name not in own
        original = getattr(owner, name)
        setattr(owner, name, self._timed(original, stage))
        self._restore.append(lambda: delattr(owner, name) if inherited else setattr(owner, name, original))

    def wrap_items(self, functions: list[Callable], stage: str) -> None:
        """Time every call of the functions in a list."""
        original = list(functions)
        functions[:] = [self._timed(function, stage) for function in functions]
        self._restore.append(lambda: functions.__setitem__(slice(None), original))

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a block."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._finish()
            self._now[name] += time.perf_counter() - start

    def end_frame(self) -> None:
        """Close the present frame's sums."""
        self._frames.append(self._now)
        self._now = defaultdict(float)

    def forget(self) -> None:
        """Drop the frames so far."""
        self._frames = []

    def seconds(self, stages: Iterable[str]) -> dict[str, np.ndarray]:
        """Seconds per frame, ``(frames,)``, by stage."""
        return {stage: np.array([frame[stage] for frame in self._frames]) for stage in stages}

    def _timed(self, function: Callable, stage: str) -> Callable:
        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.stage(stage):
                return function(*args, **kwargs)

        return timed
