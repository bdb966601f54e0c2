"""One iteration of a tile of a pyramid level in one kernel: expansions and a first guess in, displacements out.

What ``displacement_equations.py`` and ``displacement_solution.py`` compute in passes over the image, with the
equations and their sums in memory that a block of threads shares. The guess is the displacement of a coarser level,
sampled where it is wanted, or that of the same level after the iteration before.
"""

from functools import cache

import warp as wp

from dense_vs.kernels.flow.displacement_equations import EQUATIONS
from dense_vs.kernels.flow.displacement_solution import REGULARIZATION
from dense_vs.kernels.flow.guess import guess_at
from dense_vs.kernels.flow.packed_expansion import Expansion, Packed, read_expansion, write_pair
from dense_vs.kernels.image.block_memory import (
    MOST_CELLS,
    block_cells,
    block_module,
    block_number,
    block_sync,
    block_thread,
    block_threads,
)

wp.set_module_options({"enable_backward": False})

WIDTH = 40  # px of a tile; 320, 160 and 80 are multiples
HEIGHT = 30  # where the window leaves room for it
STRIP = 6  # rows that a thread sums from one reading of a column
RUN = 5  # pixels that it sums from one reading of a row; odd, so that a warp meets different banks


def tile_height(window: int) -> int:
    """Rows of a tile for a window of that side; 0 where the block's memory does not hold even a few."""
    radius = window // 2
    rows = MOST_CELLS // (EQUATIONS * (WIDTH + 2 * radius)) - 2 * radius
    return max(0, min(HEIGHT, rows // STRIP * STRIP))


@wp.func
def equations_at(
    expansion: wp.array3d(dtype=Packed),
    first: int,
    second: int,
    y: int,
    x: int,
    height: int,
    width: int,
    d: wp.vec2,
    certainty: float,
) -> Expansion:
    """A^T A (xx, xy, yy) and A^T db of a pixel, as ``displacement_equations.py`` has them."""
    pixels = height * width
    px = float(x) + d[0]
    py = float(y) + d[1]
    qx = wp.clamp(px, 0.0, float(width - 1))
    qy = wp.clamp(py, 0.0, float(height - 1))
    left = wp.clamp(int(qx), 0, width - 2)
    top = wp.clamp(int(qy), 0, height - 2)
    fx = qx - float(left)
    fy = qy - float(top)
    both = fx * fy
    at = top * width + left
    one = read_expansion(expansion, first, pixels, y * width + x)
    two = (1.0 - fx - fy + both) * read_expansion(expansion, second, pixels, at)
    two += (fx - both) * read_expansion(expansion, second, pixels, at + 1)
    two += (fy - both) * read_expansion(expansion, second, pixels, at + width)
    two += both * read_expansion(expansion, second, pixels, at + width + 1)
    if px != qx or py != qy:  # where x + d~ lies outside, image 2 does not count
        two = Expansion(0.0, 0.0, one[2], one[3], one[4])
    weight = 0.5 * certainty
    axx = weight * (one[2] + two[2])
    ayy = weight * (one[3] + two[3])
    axy = 0.5 * weight * (one[4] + two[4])
    hx = weight * (one[0] - two[0]) + axx * d[0] + axy * d[1]
    hy = weight * (one[1] - two[1]) + axy * d[0] + ayy * d[1]
    squared = axy * axy
    return Expansion(
        axx * axx + squared, axy * (axx + ayy), ayy * ayy + squared, axx * hx + axy * hy, axy * hx + ayy * hy
    )


@cache
def tile_displacement_kernel(window: tuple[float, ...], at_once: int = STRIP) -> wp.Kernel:
    """The kernel for a window's weights along one axis.

    ``at_once`` is for how many rows of a column a thread makes equations; 1 in wide blocks, which wait for the last.
    """
    taps = len(window)
    radius = taps // 2
    rows = tile_height(taps)
    side, tall = WIDTH + 2 * radius, rows + 2 * radius
    plane = side * tall
    weights = wp.types.vector(taps, wp.float32)(*window)
    Column, Strip = wp.types.vector(STRIP + 2 * radius, wp.float32), wp.types.vector(STRIP, wp.float32)
    Run = wp.types.vector(RUN, wp.float32)
    cells = block_cells(EQUATIONS * plane)
    read_cell, write_cell = cells.read_cell, cells.write_cell
    runs = WIDTH // RUN
    module = block_module(f"{__name__}_{taps}_{abs(hash(window)) % 10**8}_{at_once}")

    @wp.func
    def sum_row(begin: int) -> Run:
        """Weighted sums about RUN pixels."""
        total = Run()
        for k in range(wp.static(RUN + 2 * radius)):
            value = read_cell(begin + k)
            for s in range(wp.static(RUN)):
                if k >= s and k - s < wp.static(taps):
                    total[s] += value * weights[wp.clamp(k - s, 0, wp.static(taps - 1))]
        return total

    @wp.kernel(module=module, enable_backward=False, grid_stride=False)
    def displace(
        # In:
        slot_in: wp.array(dtype=int),
        restarted_in: wp.array(dtype=int),
        expansion_in: wp.array3d(dtype=Packed),  # (2 worlds, height, width)
        guess_in: wp.array3d(dtype=wp.vec2),  # (worlds, any height, any width)
        ratio: wp.vec2,  # width and height of the guess by those of the level
        growth: float,  # factor of the guess
        certainty_x_in: wp.array(dtype=float),
        certainty_y_in: wp.array(dtype=float),
        sign: float,  # of what is written
        # Out:
        displacement_out: wp.array3d(dtype=wp.vec2),
    ):
        """Displacements of a tile."""
        height = expansion_in.shape[1]
        width = expansion_in.shape[2]
        across = (width + wp.static(WIDTH - 1)) // wp.static(WIDTH)
        tiles = across * ((height + wp.static(rows - 1)) // wp.static(rows))
        block = block_number(wp.int64(wp.tid()))
        world = block // tiles
        tile = block - world * tiles
        top = (tile // across) * wp.static(rows)
        left = (tile - (tile // across) * across) * wp.static(WIDTH)
        worlds = expansion_in.shape[0] / 2
        first = slot_in[0] * worlds + world
        second = (1 - slot_in[0]) * worlds + world
        if restarted_in[world] != 0:
            second = first
        thread = block_thread()
        threads = block_threads()

        # A thread takes a few rows of a column. Beyond the border the equations of its pixels are repeated.
        for i in range(thread, wp.static(side * (-(-tall // at_once))), threads):
            strip = i // wp.static(side)
            column = i - strip * wp.static(side)
            x = wp.clamp(left + column - wp.static(radius), 0, width - 1)
            certainty = certainty_x_in[x]
            for row in range(strip * wp.static(at_once), wp.min((strip + 1) * wp.static(at_once), wp.static(tall))):
                y = wp.clamp(top + row - wp.static(radius), 0, height - 1)
                d = wp.vec2(0.0, 0.0)
                if second != first:
                    d = guess_at(guess_in, world, y, x, ratio, growth)
                weight = certainty * certainty_y_in[y]
                found = equations_at(expansion_in, first, second, y, x, height, width, d, weight)
                for e in range(wp.static(EQUATIONS)):
                    write_cell(e * wp.static(plane) + row * wp.static(side) + column, found[e])
        block_sync()

        # Sums down a column take the place of its equations: no other thread reads them.
        for i in range(thread, wp.static(EQUATIONS * side), threads):
            e = i // wp.static(side)
            begin = e * wp.static(plane) + i - e * wp.static(side)
            for strip in range(wp.static(rows // STRIP)):
                at = begin + strip * wp.static(STRIP * side)
                seen = Column()
                for k in range(wp.static(STRIP + 2 * radius)):
                    seen[k] = read_cell(at + k * wp.static(side))
                total = Strip()
                for s in range(wp.static(STRIP)):
                    for k in range(wp.static(taps)):
                        total[s] += seen[s + k] * weights[k]
                for s in range(wp.static(STRIP)):
                    write_cell(at + s * wp.static(side), total[s])
        block_sync()

        for i in range(thread, wp.static(rows * runs), threads):
            row = i // wp.static(runs)
            begin = (i - row * wp.static(runs)) * wp.static(RUN)
            at = row * wp.static(side) + begin
            gxx = sum_row(at)
            gxy = sum_row(at + wp.static(plane))
            gyy = sum_row(at + wp.static(2 * plane))
            hx = sum_row(at + wp.static(3 * plane))
            hy = sum_row(at + wp.static(4 * plane))
            y = top + row
            for s in range(wp.static(RUN)):
                x = left + begin + s
                if y < height and x < width:
                    inverse = sign / (gxx[s] * gyy[s] - gxy[s] * gxy[s] + wp.static(REGULARIZATION))
                    dx = (gyy[s] * hx[s] - gxy[s] * hy[s]) * inverse
                    dy = (gxx[s] * hy[s] - gxy[s] * hx[s]) * inverse
                    write_pair(displacement_out, world, height * width, y * width + x, wp.vec2(dx, dy))

    return displace
