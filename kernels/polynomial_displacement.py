"""Displacement between two polynomial expansions (Farneback 2003, section 3).

Where image 2 is image 1 displaced by d, the expansions at x and at x + d~ (d~ what is known of d) give

    A d = db    with  A = (A_1(x) + A_2(x + d~)) / 2,  db = (b_1(x) - b_2(x + d~)) / 2 + A d~

d minimises |A d - db|^2 summed over a window: (sum w A^T A) d = sum w A^T db, five sums a pixel. In the first
pixels from the image's border, where the expansions saw repeated pixels, the equations count less.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import warp as wp

from dense_vs.kernels.pixel_runs import run_begin, run_type

wp.set_module_options({"enable_backward": False})

EQUATIONS = 5  # of the symmetric A^T A: xx, xy, yy; of A^T db: x, y
REGULARISATION = 1e-3  # added to the determinant, so that d is 0 where there is no texture
BORDER_CERTAINTY = (0.14, 0.14, 0.4472, 0.4472, 0.4472)  # of the first pixels from the border, as in OpenCV


def certainty(size: int) -> np.ndarray:
    """How much the equations count along an axis of the image."""
    weights = np.ones(size, dtype=np.float32)
    count = min(len(BORDER_CERTAINTY), size)
    weights[:count] *= BORDER_CERTAINTY[:count]
    weights[size - count :] *= BORDER_CERTAINTY[:count][::-1]
    return weights


@cache
def displacement_kernels(lanes: int) -> SimpleNamespace:
    """The equations of each pixel, their sums over windows, and the solution."""
    Run = run_type(lanes)

    kernel = wp.kernel(module=f"{__name__}_{lanes}", enable_backward=False)

    @kernel
    def equations(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        slot_in: wp.array(dtype=int),
        restarted_in: wp.array(dtype=int),
        expansion_in: wp.array4d(dtype=float),  # (2 worlds, height, 5, width)
        flow_in: wp.array4d(dtype=float),  # (worlds, height, 2, width) d~
        certainty_x_in: wp.array(dtype=float),
        certainty_y_in: wp.array(dtype=float),
        # Out:
        equations_out: wp.array4d(dtype=float),  # (worlds, height, 5, width)
    ):
        """A^T A and A^T db of each pixel."""
        world, row, column = wp.tid()
        y = row_begin + row
        worlds = expansion_in.shape[0] / 2
        height = expansion_in.shape[1]
        first = slot_in[0] * worlds + world
        second = first
        if restarted_in[world] == 0:
            second = (1 - slot_in[0]) * worlds + world
        for x in range(column, width, column_step):
            dx = flow_in[world, y, 0, x]
            dy = flow_in[world, y, 1, x]
            bx = expansion_in[first, y, 0, x]
            by = expansion_in[first, y, 1, x]
            axx = expansion_in[first, y, 2, x]
            ayy = expansion_in[first, y, 3, x]
            axy = expansion_in[first, y, 4, x] * 0.5
            px = float(x) + dx
            py = float(y) + dy
            if px >= 0.0 and py >= 0.0 and px <= float(width - 1) and py <= float(height - 1):
                left = wp.min(int(px), width - 2)
                top = wp.min(int(py), height - 2)
                fx = px - float(left)
                fy = py - float(top)
                w11 = fx * fy
                w10 = fy - w11
                w01 = fx - w11
                w00 = 1.0 - fx - w10
                bx -= (
                    w00 * expansion_in[second, top, 0, left]
                    + w01 * expansion_in[second, top, 0, left + 1]
                    + w10 * expansion_in[second, top + 1, 0, left]
                    + w11 * expansion_in[second, top + 1, 0, left + 1]
                )
                by -= (
                    w00 * expansion_in[second, top, 1, left]
                    + w01 * expansion_in[second, top, 1, left + 1]
                    + w10 * expansion_in[second, top + 1, 1, left]
                    + w11 * expansion_in[second, top + 1, 1, left + 1]
                )
                axx += (
                    w00 * expansion_in[second, top, 2, left]
                    + w01 * expansion_in[second, top, 2, left + 1]
                    + w10 * expansion_in[second, top + 1, 2, left]
                    + w11 * expansion_in[second, top + 1, 2, left + 1]
                )
                ayy += (
                    w00 * expansion_in[second, top, 3, left]
                    + w01 * expansion_in[second, top, 3, left + 1]
                    + w10 * expansion_in[second, top + 1, 3, left]
                    + w11 * expansion_in[second, top + 1, 3, left + 1]
                )
                axy += 0.5 * (
                    w00 * expansion_in[second, top, 4, left]
                    + w01 * expansion_in[second, top, 4, left + 1]
                    + w10 * expansion_in[second, top + 1, 4, left]
                    + w11 * expansion_in[second, top + 1, 4, left + 1]
                )
                axx *= 0.5
                ayy *= 0.5
                axy *= 0.5
            weight = certainty_x_in[x] * certainty_y_in[y]
            axx *= weight
            ayy *= weight
            axy *= weight
            hx = bx * 0.5 * weight + axx * dx + axy * dy
            hy = by * 0.5 * weight + axy * dx + ayy * dy
            equations_out[world, y, 0, x] = axx * axx + axy * axy
            equations_out[world, y, 1, x] = axy * (axx + ayy)
            equations_out[world, y, 2, x] = axy * axy + ayy * ayy
            equations_out[world, y, 3, x] = axx * hx + axy * hy
            equations_out[world, y, 4, x] = axy * hx + ayy * hy

    @kernel
    def sum_columns(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        window_in: wp.array(dtype=float),  # (2 radius + 1,)
        equations_in: wp.array4d(dtype=Run),
        # Out:
        sums_out: wp.array4d(dtype=float),  # (worlds, height, 5, width + 2 radius)
        sum_runs_out: wp.array4d(dtype=Run),  # the same memory
    ):
        """Weighted sums of the equations down each column, the first and last column repeated beside the image."""
        world, row, column = wp.tid()
        y = row_begin + row
        last = equations_in.shape[1] - 1
        radius = window_in.shape[0] / 2
        count = (width + wp.static(lanes - 1)) // wp.static(lanes)
        for run in range(column, count, column_step):
            x = run_begin(run, wp.static(lanes), width)
            for c in range(wp.static(EQUATIONS)):
                total = Run()
                for k in range(2 * radius + 1):
                    total += equations_in[world, wp.clamp(y + k - radius, 0, last), c, x] * window_in[k]
                sum_runs_out[world, y, c, x + radius] = total
                if run == 0:
                    for k in range(radius):
                        sums_out[world, y, c, k] = total[0]
                if run == count - 1:
                    for k in range(radius):
                        sums_out[world, y, c, width + radius + k] = total[wp.static(lanes - 1)]

    @wp.func
    def sum_row(sums: wp.array4d(dtype=Run), window: wp.array(dtype=float), world: int, y: int, c: int, x: int) -> Run:
        total = Run()
        for k in range(window.shape[0]):
            total += sums[world, y, c, x + k] * window[k]
        return total

    @wp.func
    def reciprocal(a: Run) -> Run:
        result = Run()
        for i in range(wp.static(lanes)):
            result[i] = 1.0 / a[i]
        return result

    @kernel
    def solve(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        window_in: wp.array(dtype=float),
        sums_in: wp.array4d(dtype=Run),  # (worlds, height, 5, width + 2 radius)
        # Out:
        flow_out: wp.array4d(dtype=Run),  # (worlds, height, 2, width)
    ):
        """d of each pixel from the window's sums."""
        world, row, column = wp.tid()
        y = row_begin + row
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            gxx = sum_row(sums_in, window_in, world, y, 0, x)
            gxy = sum_row(sums_in, window_in, world, y, 1, x)
            gyy = sum_row(sums_in, window_in, world, y, 2, x)
            hx = sum_row(sums_in, window_in, world, y, 3, x)
            hy = sum_row(sums_in, window_in, world, y, 4, x)
            determinant = wp.cw_mul(gxx, gyy) - wp.cw_mul(gxy, gxy)
            for i in range(wp.static(lanes)):
                determinant[i] = determinant[i] + wp.static(REGULARISATION)
            inverse = reciprocal(determinant)
            flow_out[world, y, 0, x] = wp.cw_mul(wp.cw_mul(gyy, hx) - wp.cw_mul(gxy, hy), inverse)
            flow_out[world, y, 1, x] = wp.cw_mul(wp.cw_mul(gxx, hy) - wp.cw_mul(gxy, hx), inverse)

    @kernel
    def negate(
        row_begin: int,
        column_step: int,
        # In:
        displacement_in: wp.array4d(dtype=float),  # (worlds, height, 2, width)
        # Out:
        flow_out: wp.array3d(dtype=wp.vec2),
    ):
        """u = -d."""
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, flow_out.shape[2], column_step):
            flow_out[world, y, x] = wp.vec2(-displacement_in[world, y, 0, x], -displacement_in[world, y, 1, x])

    return SimpleNamespace(
        equations=equations,
        sum_columns=sum_columns,
        solve=solve,
        negate=negate,
    )
