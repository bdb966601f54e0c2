"""When a command is due, for a robot that takes a new one only so often."""

from dense_vs.checks import check_number


class CommandPace:
    """A grid of times.

    Args:
        period: between commands [s]; None for one every frame.
        time: of the first [s].

    Raises:
        DenseVSError: a period that is not above 0.
    """

    def __init__(self, period: float | None, time: float):
        self.period = None if period is None else check_number("command_period", period, above=0)
        self._next = time

    def due(self, time: float) -> bool:
        """Whether a command may go out at a time [s]; the next one may a period later."""
        if self.period is None:
            return True
        late = time - self._next
        if late < -1e-6:  # s; stamps are sums of rounded numbers
            return False
        # On a grid, which restarts after a pause.
        self._next += self.period * (1 if late < self.period else late // self.period + 1)
        return True
