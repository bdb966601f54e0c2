"""Kernels whose threads work in blocks on memory that they share: a tile of an image and the steps made of it.

A kernel computes a tile in phases; each thread takes every ``block_threads()``-th item of a phase, writes cells, and
``block_sync()`` ends the phase. On a GPU the cells are the block's shared memory, so what a tile needs on the way
never goes through the device's memory. On a CPU a block is one thread, which takes all items, and the cells are
memory of the process: launch such a kernel from one thread at a time there. It is declared with
``grid_stride=False`` and launched by :func:`block_launch`; ``block_number(wp.tid())`` says which tile it computes.
"""

from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

BLOCK = 256  # threads
WIDE_BLOCK = 1024  # where there are too few tiles to keep a GPU busy, and each should be done soon
MOST_CELLS = 44 * 1024 // 4  # floats: of the 48 KiB that every GPU gives a block, Warp takes 4 bytes a thread

_CELL = """
#if defined(__CUDA_ARCH__)
    __shared__ float cells[%(count)d];
#else
    static float cells[%(count)d];
#endif
    if (writes)
        cells[place] = value;
    return cells[place];
"""


@wp.func_native("WP_TILE_SYNC();")
def block_sync():
    """Wait until all threads of the block are here."""
    ...


@wp.func_native("return WP_TILE_THREAD_IDX;")
def block_thread() -> int:
    """Number of the thread in its block."""
    ...


@wp.func_native("return WP_TILE_BLOCK_DIM;")
def block_threads() -> int:
    """Threads of a block."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return (int)(blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z));
#else
    return (int)(thread / WP_TILE_BLOCK_DIM);
#endif
""")
def block_number(thread: wp.int64) -> int:
    """Number of a thread's block."""
    ...


@cache
def block_cells(count: int) -> SimpleNamespace:
    """Functions ``read_cell(place)`` and ``write_cell(place, value)`` of ``count`` floats that a block shares."""

    @wp.func_native(_CELL % {"count": count})
    def cell(place: int, value: float, writes: bool) -> float: ...

    @wp.func
    def read_cell(place: int) -> float:
        return cell(place, 0.0, False)

    @wp.func
    def write_cell(place: int, value: float):
        cell(place, value, True)

    return SimpleNamespace(read_cell=read_cell, write_cell=write_cell)


def block_module(name: str) -> Any:
    """Warp module for kernels of blocks, with their short loops unrolled so that vectors stay in registers."""
    module = wp.get_module(name)
    wp.set_module_options({"max_unroll": 64}, module)
    return module


def few_blocks(blocks: int, device: Any) -> bool:
    """Whether a GPU has room for all of these blocks at once, however wide they are."""
    device = wp.get_device(device)
    return device.is_cuda and blocks <= device.sm_count


def block_launch(
    kernel: Any, blocks: int, arguments: Sequence[Any], device: Any, wide: bool = False
) -> Callable[[], None]:
    """Bind a kernel of blocks to its arrays; the result launches it."""
    several = wp.get_device(device).is_cuda or wp.config.enable_cpu_blocks
    threads = (WIDE_BLOCK if wide else BLOCK) if several else 1
    command: Any = wp.launch(
        kernel, dim=blocks * threads, inputs=list(arguments), device=device, block_dim=threads, record_cmd=True
    )
    return command.launch
