"""A process apart that tells the robot to hold when the loop dies: by an error, by a kill, or because it hangs.

The loop's process holds the one end of a pipe and writes a byte a frame. The watchdog reads the other end: at its end,
which the system brings about however the loop dies, or when no byte came for a while, it calls the driver's hold
function. A driver declares it as :class:`Hold`: the name of a function and what to call it with as JSON takes it, since
nothing of the dead process is left to call. Where the robot is commanded by a bus that one process at a time can open,
the function opens the bus anew: the system closed it with the process.

    python -m dense_vs.drivers.watchdog MODULE:FUNCTION '{"port": "/dev/ttyACM0"}' SECONDS
"""

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from dense_vs.checks import check_number
from dense_vs.errors import DenseVSError

GOODBYE = b"q"  # the loop ended as it should: nothing to do
BEAT = b"."
TRIES, PAUSE = 20, 0.1  # of a bus that is not free yet [s]


@dataclass(frozen=True)
class Hold:
    """How to make a robot hold from a process that knows nothing of it.

    Attributes:
        function: ``"module:name"``, importable in a fresh process.
        arguments: keyword arguments, as JSON takes them.
        timeout: time without a frame after which it is called [s].
    """

    function: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    timeout: float = 1.0

    def __post_init__(self):
        module, colon, name = self.function.partition(":")
        if not (module and colon and name):
            raise DenseVSError(f"function is {self.function!r}; expected 'module:name'")
        check_number("timeout", self.timeout, above=0)


class Watchdog:
    """Starts the process and tells it that the loop is alive.

    Args:
        hold: how the robot is told to hold.
    """

    def __init__(self, hold: Hold):
        words = [sys.executable, "-m", __name__, hold.function, json.dumps(dict(hold.arguments)), str(hold.timeout)]
        # A session of its own: Ctrl+C and the terminal's end reach the loop, not who watches it.
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, start_new_session=True, bufsize=0)
        assert self._process.stdin is not None
        self._pipe = self._process.stdin
        os.set_blocking(self._pipe.fileno(), False)

    @property
    def alive(self) -> bool:
        """Whether the process is there."""
        return self._process.poll() is None

    def beat(self) -> None:
        """A frame is done; never waits. A full pipe holds beats enough."""
        with suppress(OSError, ValueError):  # the process, or the pipe, is gone already
            self._pipe.write(BEAT)

    def end(self, timeout: float = 5.0) -> None:
        """The loop ends as it should; the robot is left as it is."""
        with suppress(OSError):
            self._pipe.write(GOODBYE)
            self._pipe.close()
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def watch(stream: int, timeout: float) -> str:
    """Read beats from a file descriptor until they end; ``"goodbye"``, ``"gone"`` or ``"silent"``."""
    first = os.read(stream, 1)  # waits for the first frame, however long kernels compile
    if first in (b"", GOODBYE):
        return "goodbye" if first else "gone"
    while True:
        ready, _, _ = select.select([stream], [], [], timeout)
        if not ready:
            return "silent"
        got = os.read(stream, 4096)
        if GOODBYE in got:
            return "goodbye"
        if not got:
            return "gone"


def main(arguments: list[str] | None = None) -> int:
    """Watch standard input; hold where the loop ends otherwise than by saying goodbye, or is silent."""
    function, told, timeout = sys.argv[1:4] if arguments is None else arguments
    module, _, name = function.partition(":")
    hold = getattr(import_module(module), name)  # an import that fails shows before the robot moves
    while (why := watch(sys.stdin.fileno(), float(timeout))) != "goodbye":
        print(f"dense-vs watchdog: the loop is {why}; telling the robot to hold", file=sys.stderr, flush=True)
        held = _hold(hold, json.loads(told))
        if why == "gone":
            return 0 if held else 1
    return 0


def _hold(hold: Callable[..., Any], arguments: dict[str, Any]) -> bool:
    """Try until the bus is free; whether it worked."""
    for left in reversed(range(TRIES)):
        try:
            hold(**arguments)
            return True
        except Exception as error:  # said where it stays so
            if not left:
                print(f"dense-vs watchdog: cannot make the robot hold: {error}", file=sys.stderr, flush=True)
        time.sleep(PAUSE)
    return False


if __name__ == "__main__":
    sys.exit(main())
