"""How kernels over images are launched: row bands on all CPU cores, one grid on a GPU.

Warp runs a CPU launch on one core but releases the interpreter lock meanwhile, so an image is cut into
bands of rows and each band is launched from its own thread. A pixel kernel starts with

    def kernel(row_begin: int, column_step: int, ...):
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, width, column_step):

On a CPU the grid is (worlds, rows of the band, 1): a thread walks a whole row, which is about 1.7 times as
fast as a thread a pixel. On a GPU it is (worlds, height, width): a thread a pixel. No pixel depends
on another one's result, so any number of threads gives the same bits.
"""

import os
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import warp as wp

from dense_vs.kernels.cpu_threads import share_out
from dense_vs.kernels.recorded import recorded_parts


def available_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


BANDS_PER_THREAD = 4  # on a core that others use too, 1.3 ms where one band a thread took 3.4 (median)


def row_bands(threads: int, height: int, device: wp.Device) -> int:
    """How many bands of rows :class:`PixelLaunch` cuts an image into, for kernels that sum up each apart.

    Band b begins at row ``height * b // bands``. There are more than threads, as a thread whose core is busy elsewhere
    takes fewer of them.
    """
    if not device.is_cpu or threads <= 1:
        return 1
    return min(BANDS_PER_THREAD * threads, height)


class PixelLaunch:
    """A pixel kernel bound to its arrays: recorded once, launched every frame without packing arguments.

    Args:
        kernel: pixel kernel, as in the module's docstring.
        shape: (worlds, height, width) of the image it walks.
        arguments: what follows ``row_begin`` and ``column_step``, inputs before outputs.
        device: Warp device of the arrays.
        threads: row bands launched at once on a CPU; ignored on a GPU.
    """

    def __init__(
        self,
        kernel: Any,
        shape: tuple[int, int, int],
        arguments: Sequence[Any],
        device: Any,
        threads: int = 1,
    ):
        worlds, height, width = shape
        device = wp.get_device(device)
        if device.is_cpu:
            self._threads = min(threads, height)
            bands = row_bands(threads, height, device)
            edges = [height * band // bands for band in range(bands + 1)]
            grids = [(first, (worlds, last - first, 1)) for first, last in pairwise(edges)]
            column_step = 1
        else:
            self._threads = 1
            grids = [(0, (worlds, height, width))]
            column_step = width
        self._arguments = arguments  # keeps the arrays alive as long as the recorded pointers
        self._commands = recorded_parts(kernel, grids, [column_step, *arguments], device)
        self._launches = [command.launch for command in self._commands]

    def __call__(self, stream: wp.Stream | None = None) -> None:
        """Run on the arrays' present content; on a CPU the result is there on return.

        Args:
            stream: of a GPU, the device's present one unless given.
        """
        if self._threads == 1:
            for command in self._commands:
                command.launch(stream)
        else:
            share_out(self._launches, self._threads)


def launch_pixels(
    kernel: Any,
    shape: tuple[int, int, int],
    arguments: Sequence[Any],
    device: Any,
    threads: int = 1,
) -> None:
    """Launch a pixel kernel once; see :class:`PixelLaunch` for the arguments."""
    PixelLaunch(kernel, shape, arguments, device, threads)()
