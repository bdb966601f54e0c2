"""Pixel kernels for a GPU alone: a block of threads takes a tile of 32 x 8 pixels of one world.

Neighbours above and below then share a cache, and the world is the same for the whole block, which the compiler knows
as it follows from the block's number: addresses of a world are computed once for 32 threads, and no thread divides
64-bit numbers to find its pixel. A kernel for it is declared with ``grid_stride=False`` and starts with

    def kernel(...):
        place = tile_pixel(wp.int64(wp.tid()), height, width)
        world, y, x = place[0], place[1], place[2]
        if x >= width or y >= height:
            return

Warp spreads more than 65,535 blocks over three axes of the grid. On a CPU such a kernel runs too, on one core;
:class:`dense_vs.kernels.launch.PixelLaunch` is the way there.
"""

from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

BLOCK = 256  # threads, 32 x 8

_TILE_PIXEL = """
#if defined(__CUDA_ARCH__)
    const unsigned tile = blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z), pixel = threadIdx.x;
#else
    const unsigned tile = (unsigned)(thread >> 8), pixel = (unsigned)(thread & 255);
#endif
    const unsigned across = (unsigned)(width + 31) >> 5, tiles = across * ((unsigned)(height + 7) >> 3);
    const unsigned world = tile / tiles, place = tile - world * tiles, row = place / across;
    const unsigned column = place - row * across;
    return wp::vec_t<3, int>((int)world, (int)(8 * row + (pixel >> 5)), (int)(32 * column + (pixel & 31)));
"""


@wp.func_native(_TILE_PIXEL)
def tile_pixel(thread: wp.int64, height: int, width: int) -> wp.vec3i:
    """World, y and x of a thread; x or y may lie beyond the image."""
    ...


def tile_launch(kernel: Any, shape: tuple[int, int, int], arguments: Sequence[Any], device: Any) -> Callable[[], None]:
    """Bind a tile kernel to its arrays; the result launches it.

    Args:
        kernel: as in the module's docstring.
        shape: (worlds, height, width) of the image.
        arguments: of the kernel, inputs before outputs.
        device: Warp device of the arrays.
    """
    worlds, height, width = shape
    tiles = worlds * -(-height // 8) * -(-width // 32)
    command: Any = wp.launch(
        kernel, dim=tiles * BLOCK, inputs=list(arguments), device=device, block_dim=BLOCK, record_cmd=True
    )
    return command.launch
