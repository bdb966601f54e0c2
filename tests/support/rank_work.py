"""Work for processes that share a batch: it answers, fails, is killed, or waits until it is ended."""

import os
import signal


def number(rank, offset):
    """The rank's number and more."""
    return rank.number + offset


def fail(rank):
    """Process 1 fails; the others wait."""
    if rank.number == 1:
        raise ValueError("no such thing")
    signal.pause()


def die(rank):
    """Process 1 is killed; the others wait."""
    if rank.number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    signal.pause()
