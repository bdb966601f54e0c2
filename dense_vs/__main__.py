"""The program ``dense-vs``, also ``python -m dense_vs``: the command line in a process of its own.

An interrupt while modules are still imported, or while the interpreter ends, ends the process as it does any other
program, without a traceback: compiled modules ignore what is raised while they are imported. In between
``dense_vs.cli.main`` answers it. A request to terminate is answered as an interrupt is, so that no unfinished file and
no worker stays; only the exit code tells them apart.
"""

import os
import signal
import sys

signal.signal(signal.SIGINT, signal.SIG_DFL)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported; see dense_vs.device.one_blas_thread
os.environ.setdefault("MUJOCO_GL", "disable")  # no OpenGL here; MuJoCo would start processes to look for it

from dense_vs.cli.interrupts import Interrupts  # noqa: E402 - an interrupt of its import ends the process
from dense_vs.cli.main import INTERRUPTED, main  # noqa: E402 - it imports NumPy, which reads the variables above


def program() -> int:
    """Run ``dense-vs``; the process's exit code."""
    interrupts = Interrupts()
    try:
        code = main(imported=interrupts.take)
    except KeyboardInterrupt:  # while an earlier one was answered
        code = INTERRUPTED
    except Exception:
        if not interrupts.asked:
            raise
        code = INTERRUPTED  # while an extension module was imported, which made an ImportError of it
    interrupts.leave()
    return 128 + interrupts.asked[-1] if code == INTERRUPTED and interrupts.asked else code


if __name__ == "__main__":
    sys.exit(program())
