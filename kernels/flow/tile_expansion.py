"""Polynomial expansion of a tile of a pyramid level in one kernel: image in, 16 bytes a pixel out.

What ``resampling.py`` and ``polynomial_expansion.py`` compute in four passes over the image, here with the level's
image and its moments in memory that a block of threads shares.
"""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.flow.packed_expansion import Expansion, Packed, pixel_reader, write_expansion
from dense_vs.kernels.flow.polynomial_expansion import applicability
from dense_vs.kernels.image.block_memory import (
    block_cells,
    block_module,
    block_number,
    block_sync,
    block_thread,
    block_threads,
)

wp.set_module_options({"enable_backward": False})

WIDTH = 40  # px of a tile; 320, 160 and 80 are multiples
HEIGHT = 30
STRIP = 6  # rows that a thread computes from one reading of a column
RUN = 5  # pixels that it computes from one reading of a row; odd, so that a warp meets different banks


def cells_of(radius: int) -> int:
    """Floats that a block shares."""
    side = WIDTH + 2 * radius
    return side * (HEIGHT + 2 * radius) + 3 * HEIGHT * side


def _resampled(row_taps: int, column_taps: int, dtype: Any) -> tuple[Any, wp.Function]:
    """Weights of a column, and the function that makes a pixel of a level from the image's pixels from ``at`` on."""
    Across = wp.types.vector(column_taps, wp.float32)
    read_pixel = pixel_reader(dtype).read_pixel

    @wp.func
    def resampled(
        image: wp.array3d(dtype=dtype),
        world: int,
        pixels: int,
        at: int,
        width: int,
        row_weights: wp.array2d(dtype=float),
        y: int,
        column_weights: Across,
    ) -> float:
        value = float(0.0)
        for a in range(wp.static(row_taps)):
            line = float(0.0)
            for b in range(wp.static(column_taps)):
                line += read_pixel(image, world, pixels, at + a * width + b) * column_weights[b]
            value += line * row_weights[a, y]
        return value

    return Across, resampled


def _rows(Taps: Any, read_cell: wp.Function) -> tuple[wp.Function, wp.Function]:
    """Functions that read what RUN pixels of a row see, and sum it by weights."""
    taps = Taps._length_
    Row, Run = wp.types.vector(RUN + taps - 1, wp.float32), wp.types.vector(RUN, wp.float32)

    @wp.func
    def read_row(begin: int) -> Row:
        values = Row()
        for k in range(wp.static(RUN + taps - 1)):
            values[k] = read_cell(begin + k)
        return values

    @wp.func
    def moments_of_row(values: Row, weights: Taps) -> Run:
        total = Run()
        for s in range(wp.static(RUN)):
            for k in range(wp.static(taps)):
                total[s] += values[s + k] * weights[k]
        return total

    return read_row, moments_of_row


@cache
def tile_expansion_kernel(
    radius: int, sigma: float, row_taps: int, column_taps: int, dtype: Any, at_once: int = STRIP
) -> wp.Kernel:
    """The kernel for an expansion's radius and sigma, and for how many image pixels a level's pixel is made of.

    ``at_once`` is how many rows of a column a thread resamples; 1 in wide blocks, where all wait for the last.
    """
    side, tall, taps = WIDTH + 2 * radius, HEIGHT + 2 * radius, 2 * radius + 1
    moments_at = side * tall  # the cells after the level's image
    weights, scale = applicability(radius, sigma)
    over_s2, over_variance, s2 = (float(value) for value in scale)
    Taps = wp.types.vector(taps, wp.float32)
    g0, g1, g2 = (
        Taps(*np.concatenate([sign * half[:0:-1], half])) for half, sign in zip(weights, (1, -1, 1), strict=True)
    )
    Column = wp.types.vector(STRIP + 2 * radius, wp.float32)
    Strip = wp.types.vector(STRIP, wp.float32)
    Across, resampled = _resampled(row_taps, column_taps, dtype)
    cells = block_cells(cells_of(radius))
    read_cell, write_cell = cells.read_cell, cells.write_cell
    read_row, moments_of_row = _rows(Taps, read_cell)
    runs = WIDTH // RUN
    module = block_module(
        f"{__name__}_{radius}_{round(1e6 * sigma)}_{row_taps}_{column_taps}_{dtype.__name__}_{at_once}"
    )

    @wp.kernel(module=module, enable_backward=False, grid_stride=False)
    def expand(
        # In:
        height: int,
        width: int,
        row_start_in: wp.array(dtype=int),  # (height + 2 radius,)
        row_weights_in: wp.array2d(dtype=float),
        column_start_in: wp.array(dtype=int),
        column_weights_in: wp.array2d(dtype=float),
        image_in: wp.array3d(dtype=dtype),
        slot_in: wp.array(dtype=int),
        # Out:
        expansion_out: wp.array3d(dtype=Packed),  # (2 worlds, height, width)
    ):
        """Expansions of a tile, written to the worlds of a slot."""
        across = (width + wp.static(WIDTH - 1)) // wp.static(WIDTH)
        tiles = across * ((height + wp.static(HEIGHT - 1)) // wp.static(HEIGHT))
        block = block_number(wp.int64(wp.tid()))
        world = block // tiles
        tile = block - world * tiles
        top = (tile // across) * wp.static(HEIGHT)
        left = (tile - (tile // across) * across) * wp.static(WIDTH)
        image_width = image_in.shape[2]
        image_pixels = image_in.shape[1] * image_width
        thread = block_thread()
        threads = block_threads()

        # A thread takes a few rows of a column, whose weights it reads once.
        for i in range(thread, wp.static(side * (-(-tall // at_once))), threads):
            strip = i // wp.static(side)
            column = i - strip * wp.static(side)
            x = wp.min(left + column, width + wp.static(2 * radius - 1))
            begin = column_start_in[x]
            across_weights = Across()
            for b in range(wp.static(column_taps)):
                across_weights[b] = column_weights_in[b, x]
            for row in range(strip * wp.static(at_once), wp.min((strip + 1) * wp.static(at_once), wp.static(tall))):
                y = wp.min(top + row, height + wp.static(2 * radius - 1))
                at = row_start_in[y] * image_width + begin
                value = resampled(image_in, world, image_pixels, at, image_width, row_weights_in, y, across_weights)
                write_cell(row * wp.static(side) + column, value)
        block_sync()

        # Sums of f, y f and y^2 f down the columns.
        for i in range(thread, wp.static(side * (HEIGHT // STRIP)), threads):
            strip = i // wp.static(side)
            begin = strip * wp.static(STRIP * side) + (i - strip * wp.static(side))
            seen = Column()
            for k in range(wp.static(STRIP + 2 * radius)):
                seen[k] = read_cell(begin + k * wp.static(side))
            m0 = Strip()
            m1 = Strip()
            m2 = Strip()
            for s in range(wp.static(STRIP)):
                for k in range(wp.static(taps)):
                    m0[s] += seen[s + k] * g0[k]
                    m1[s] += seen[s + k] * g1[k]
                    m2[s] += seen[s + k] * g2[k]
            for s in range(wp.static(STRIP)):
                at = wp.static(moments_at) + begin + s * wp.static(side)
                write_cell(at, m0[s])
                write_cell(at + wp.static(HEIGHT * side), m1[s])
                write_cell(at + wp.static(2 * HEIGHT * side), m2[s])
        block_sync()

        for i in range(thread, wp.static(HEIGHT * runs), threads):
            row = i // wp.static(runs)
            begin = (i - row * wp.static(runs)) * wp.static(RUN)
            at = wp.static(moments_at) + row * wp.static(side) + begin
            values = read_row(at)
            m00 = moments_of_row(values, g0)
            m10 = moments_of_row(values, g1)
            m20 = moments_of_row(values, g2)
            values = read_row(at + wp.static(HEIGHT * side))
            m01 = moments_of_row(values, g0)
            m11 = moments_of_row(values, g1)
            m02 = moments_of_row(read_row(at + wp.static(2 * HEIGHT * side)), g0)
            y = top + row
            plane = slot_in[0] * (expansion_out.shape[0] / 2) + world
            for s in range(wp.static(RUN)):
                x = left + begin + s
                if y < height and x < width:
                    mean = m00[s] * wp.static(s2)
                    found = Expansion(
                        m10[s] * wp.static(over_s2),
                        m01[s] * wp.static(over_s2),
                        (m20[s] - mean) * wp.static(over_variance),
                        (m02[s] - mean) * wp.static(over_variance),
                        m11[s] * wp.static(over_s2 * over_s2),
                    )
                    write_expansion(expansion_out, plane, height * width, y * width + x, found)

    return expand
