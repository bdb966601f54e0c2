"""What the loop's thread shows to the page's: the newest frame only, so nobody waits and nothing piles up."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dense_vs.pipeline.frame_pipeline import ProcessedFrame

LOG_LINES = 200
PLOT_POINTS = 900
PLOT_PERIOD = 0.2  # s


@dataclass(frozen=True)
class Snapshot:
    """One frame as the page may draw it; nothing in it changes any more.

    Attributes:
        number: of the frame, counted by the session.
        frame: what the loop made of it.
        before: the frame before; None for the first.
        picture: the camera's own image, RGB uint8 ``(H, W, 3)`` or gray, before scaling.
        layers: what some page asked to see, by name: a column of J ``(H, W, 2)``, labels ``(H, W)``.
        state: what the page is told beside the image, as JSON takes it.
    """

    number: int
    frame: ProcessedFrame
    before: ProcessedFrame | None
    picture: np.ndarray
    layers: Mapping[str, np.ndarray] = field(default_factory=dict)
    state: Mapping[str, Any] = field(default_factory=dict)


class Board:
    """Holds the newest snapshot, the log and the plots; safe from any thread.

    Attributes:
        on_change: called without arguments, from the thread that changed something; must return at once.
        wanted: names of the layers that pages show now; whoever serves them keeps it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._snapshot: Snapshot | None = None
        self._lines: deque[dict[str, Any]] = deque(maxlen=LOG_LINES)
        self._plots: deque[list[float | None]] = deque(maxlen=PLOT_POINTS)
        self._line_number = 0
        self.on_change: Callable[[], None] = lambda: None
        self.wanted: frozenset[str] = frozenset()

    @property
    def snapshot(self) -> Snapshot | None:
        """The newest; None before the first."""
        return self._snapshot

    def show(self, snapshot: Snapshot) -> None:
        """Put up a snapshot in place of the one before."""
        self._snapshot = snapshot
        self.on_change()

    def log(self, text: str, level: str = "info") -> None:
        """Add a line for the user; ``level`` is info, warning or error."""
        with self._lock:
            self._line_number += 1
            line = {"number": self._line_number, "time": time.time(), "level": level, "text": text}
            self._lines.append(line)
        self.on_change()

    def lines(self, after: int = 0) -> list[dict[str, Any]]:
        """Lines of the log after a number, the oldest first."""
        with self._lock:
            return [line for line in self._lines if line["number"] > after]

    def plot(self, time: float, error: float, explained: float) -> None:
        """Add the largest error [px] and the explained motion at a time [s]; not more often than the plots show."""
        with self._lock:
            if self._plots and 0 <= time - float(self._plots[-1][0] or 0.0) < PLOT_PERIOD:
                return
            self._plots.append([round(time, 3), plain(error), plain(explained, 4)])

    def plots(self) -> list[list[float | None]]:
        """Time, error and explained motion so far."""
        with self._lock:
            return list(self._plots)


def plain(value: float, digits: int = 3) -> float | None:
    """A number as JSON takes it; None where it is not finite."""
    return round(float(value), digits) if np.isfinite(value) else None
