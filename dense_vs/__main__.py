"""The program ``dense-vs``, also ``python -m dense_vs``: the command line in a process of its own.

An interrupt while modules are still imported, or while the interpreter ends, ends the process as it does any other
program, without a traceback; in between ``dense_vs.cli.main`` answers it.
"""

import signal
import sys

signal.signal(signal.SIGINT, signal.SIG_DFL)

from dense_vs.cli.main import INTERRUPTED, main  # noqa: E402


def program() -> int:
    """Run ``dense-vs``; the process's exit code."""
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        code = main()
    except KeyboardInterrupt:  # while an earlier one was answered
        code = INTERRUPTED
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return code


if __name__ == "__main__":
    sys.exit(program())
