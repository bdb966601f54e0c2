"""Who steers: one page at a time holds control, the others watch. Stop is everybody's.

The page in control says several times a second that it is there. Where it falls silent, closes or hides, commands stop
and control is free again.
"""

import time
from collections.abc import Callable

SILENT_SECONDS = 0.8


class Control:
    """Keeps who holds control.

    Args:
        stop: stops the robot; takes the reason.
        clock: of the computer [s].
    """

    def __init__(self, stop: Callable[[str], None], clock: Callable[[], float] = time.monotonic):
        self._stop, self._clock = stop, clock
        self._holder: int | None = None
        self._heard = -1e9

    @property
    def holder(self) -> int | None:
        """The client in control; None where nobody is."""
        return self._holder

    def take(self, client: int) -> bool:
        """Take control where nobody holds it; whether this client holds it now."""
        if self._holder is None:
            self._holder = client
            self._heard = self._clock()
        return self._holder == client

    def heard(self, client: int) -> None:
        """A client is there."""
        if client == self._holder:
            self._heard = self._clock()

    def leave(self, client: int, reason: str) -> None:
        """A client gives control up, or is gone."""
        if client == self._holder:
            self._holder = None
            self._stop(reason)

    def check(self) -> None:
        """Stop where the client in control has fallen silent; to be called again and again."""
        if self._holder is not None and self._clock() - self._heard > SILENT_SECONDS:
            self.leave(self._holder, "the connection to the page in control was lost")
