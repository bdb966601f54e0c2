"""Cores of one process among several that run side by side."""

import os


def keep_to_share(slot: int, jobs: int) -> None:
    """Keep this process, and what it starts, to the cores of its slot; alone it may use all of them."""
    if jobs < 2 or not hasattr(os, "sched_setaffinity"):
        return
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, set(cores[slot % jobs :: jobs]) or {cores[slot % len(cores)]})
