"""Displacements that solve the equations of ``displacement_equations.py`` over a window around each pixel.

The window's weights are separable: sums down columns, then along rows, then a 2 x 2 system a pixel.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.displacement_equations import EQUATIONS
from dense_vs.kernels.pixel_runs import CPU_FLAGS_SHALLOW, run_begin, run_module, run_type

wp.set_module_options({"enable_backward": False})

SUMMED_ROWS = 4  # by a thread of the sums down columns
ROW_STEP = 4  # pixels of a window's row that are added at once
REGULARISATION = 1e-3  # added to the determinant, so that d is 0 where there is no texture


@cache
def solution_kernels(lanes: int) -> SimpleNamespace:
    """The sums over windows, and the solution."""
    Run = run_type(lanes)
    kernel = wp.kernel(module=run_module(f"{__name__}_{lanes}", CPU_FLAGS_SHALLOW), enable_backward=False)

    @wp.func
    def write_sum(
        sums: wp.array4d(dtype=float),
        sum_runs: wp.array4d(dtype=Run),
        world: int,
        y: int,
        c: int,
        run: int,
        width: int,
        radius: int,
        value: Run,
    ):
        if y < sums.shape[1]:
            sum_runs[world, y, c, run_begin(run, wp.static(lanes), width) + radius] = value
            if run == 0:
                for k in range(radius):
                    sums[world, y, c, k] = value[0]
            if (run + 1) * wp.static(lanes) >= width:
                for k in range(width + radius, sums.shape[3]):
                    sums[world, y, c, k] = value[wp.static(lanes - 1)]

    @kernel
    def sum_columns(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        window_in: wp.array(dtype=float),  # (2 radius + 1,) between SUMMED_ROWS - 1 zeros on either side
        equations_in: wp.array4d(dtype=Run),
        # Out:
        sums_out: wp.array4d(dtype=float),  # (worlds, height, 5, width + 2 radius and more)
        sum_runs_out: wp.array4d(dtype=Run),  # the same memory
    ):
        """Weighted sums of the equations down each column, four rows from one reading of their windows.

        The first and the last column are repeated beside the image.
        """
        world, row, column = wp.tid()
        y = (row_begin + row) * wp.static(SUMMED_ROWS)
        height = equations_in.shape[1]
        radius = (window_in.shape[0] - wp.static(2 * SUMMED_ROWS - 1)) / 2
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            for c in range(wp.static(EQUATIONS)):
                sum_0 = Run()
                sum_1 = Run()
                sum_2 = Run()
                sum_3 = Run()
                for k in range(2 * radius + wp.static(SUMMED_ROWS)):
                    equation = equations_in[world, wp.clamp(y + k - radius, 0, height - 1), c, x]
                    sum_0 += equation * window_in[k + 3]
                    sum_1 += equation * window_in[k + 2]
                    sum_2 += equation * window_in[k + 1]
                    sum_3 += equation * window_in[k]
                write_sum(sums_out, sum_runs_out, world, y, c, run, width, radius, sum_0)
                write_sum(sums_out, sum_runs_out, world, y + 1, c, run, width, radius, sum_1)
                write_sum(sums_out, sum_runs_out, world, y + 2, c, run, width, radius, sum_2)
                write_sum(sums_out, sum_runs_out, world, y + 3, c, run, width, radius, sum_3)

    @wp.func
    def sum_row(sums: wp.array4d(dtype=Run), window: wp.array(dtype=float), world: int, y: int, c: int, x: int) -> Run:
        total = Run()
        for k in range(0, window.shape[0], wp.static(ROW_STEP)):
            first = sums[world, y, c, x + k] * window[k] + sums[world, y, c, x + k + 1] * window[k + 1]
            second = sums[world, y, c, x + k + 2] * window[k + 2] + sums[world, y, c, x + k + 3] * window[k + 3]
            total += first + second
        return total

    @wp.func
    def solution(sums: wp.array4d(dtype=Run), window: wp.array(dtype=float), world: int, y: int, x: int):
        gxx = sum_row(sums, window, world, y, 0, x)
        gxy = sum_row(sums, window, world, y, 1, x)
        gyy = sum_row(sums, window, world, y, 2, x)
        hx = sum_row(sums, window, world, y, 3, x)
        hy = sum_row(sums, window, world, y, 4, x)
        determinant = wp.cw_mul(gxx, gyy) - wp.cw_mul(gxy, gxy)
        inverse = Run()
        for i in range(wp.static(lanes)):
            inverse[i] = 1.0 / (determinant[i] + wp.static(REGULARISATION))
        dx = wp.cw_mul(wp.cw_mul(gyy, hx) - wp.cw_mul(gxy, hy), inverse)
        dy = wp.cw_mul(wp.cw_mul(gxx, hy) - wp.cw_mul(gxy, hx), inverse)
        return dx, dy

    @kernel
    def solve(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        window_in: wp.array(dtype=float),  # 0 beyond the window, up to a multiple of ROW_STEP
        sums_in: wp.array4d(dtype=Run),  # (worlds, height, 5, width + what the window holds - 1)
        # Out:
        displacement_out: wp.array4d(dtype=Run),  # (worlds, height, 2, width)
    ):
        """d of each pixel from its window's sums."""
        world, row, column = wp.tid()
        y = row_begin + row
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            dx, dy = solution(sums_in, window_in, world, y, x)
            displacement_out[world, y, 0, x] = dx
            displacement_out[world, y, 1, x] = dy

    @kernel
    def backward_flow(
        row_begin: int,
        column_step: int,
        # In:
        displacement_in: wp.array4d(dtype=float),
        # Out:
        flow_out: wp.array3d(dtype=wp.vec2),
    ):
        """u = -d at each pixel of the present image, where d leads to the previous one.

        Apart from ``solve``: components side by side are written slowly, and would slow the arithmetic.
        """
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, flow_out.shape[2], column_step):
            flow_out[world, y, x] = wp.vec2(-displacement_in[world, y, 0, x], -displacement_in[world, y, 1, x])

    return SimpleNamespace(sum_columns=sum_columns, solve=solve, backward_flow=backward_flow)
