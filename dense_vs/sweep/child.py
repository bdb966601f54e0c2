"""Runs the ``dense-vs`` program in a process that ends when the one that started it does.

python -m dense_vs.sweep.child COMMAND ...
"""

import os
import runpy
import threading
import time


def _end_with_parent(parent: int, every: float = 0.5) -> None:
    while os.getppid() == parent:
        time.sleep(every)
    os._exit(1)  # nobody is left to take the result


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    runpy.run_module("dense_vs", run_name="__main__")
