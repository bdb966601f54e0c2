"""The program ``dense-vs``, also ``python -m dense_vs``: the command line in a process of its own.

An interrupt while modules are still imported, or while the interpreter ends, ends the process as it does any other
program, without a traceback: compiled modules ignore what is raised while they are imported. In between
``dense_vs.cli.main`` answers it. A request to terminate is answered as an interrupt is, so that no unfinished file and
no worker stays; only the exit code tells them apart.
"""

import _thread
import os
import signal
import sys
import threading

signal.signal(signal.SIGINT, signal.SIG_DFL)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported; see dense_vs.device.one_blas_thread
os.environ.setdefault("MUJOCO_GL", "disable")  # no OpenGL here; MuJoCo would start processes to look for it

from dense_vs.cli.main import INTERRUPTED, main  # noqa: E402 - what stands above has to be done before

SOON = 0.02  # s


def program() -> int:
    """Run ``dense-vs``; the process's exit code."""
    asked: list[int] = []

    def stop(number: int, _: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    def ignored(error: "sys.UnraisableHookArgs") -> None:
        """Ask again: Python ignores what is raised in the callback of a weak reference, as imports have them."""
        if not (asked and isinstance(error.exc_value, KeyboardInterrupt)):
            sys.__unraisablehook__(error)
            return
        again = threading.Timer(SOON, _thread.interrupt_main, (asked[-1],))
        again.daemon = True
        again.start()

    def imported() -> None:
        sys.unraisablehook = ignored
        signal.signal(signal.SIGINT, stop)
        signal.signal(signal.SIGTERM, stop)

    try:
        code = main(imported=imported)
    except KeyboardInterrupt:  # while an earlier one was answered
        code = INTERRUPTED
    except Exception:
        if not asked:
            raise
        code = INTERRUPTED  # while an extension module was imported, which made an ImportError of it
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return 128 + asked[-1] if code == INTERRUPTED and asked else code


if __name__ == "__main__":
    sys.exit(program())
