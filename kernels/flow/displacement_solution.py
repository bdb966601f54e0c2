"""Displacements that solve the equations of ``displacement_equations.py`` over a window around each pixel.

The window's weights are separable: sums down columns, then along rows, then a 2 x 2 system a pixel.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from dense_vs.kernels.flow.displacement_equations import EQUATIONS
from dense_vs.kernels.image.pixel_runs import CPU_FLAGS_SHALLOW, lanes_on, run_begin, run_module, run_type

wp.set_module_options({"enable_backward": False})

SUMMED_ROWS = 4  # by a thread of the sums down columns
ROW_STEP = 4  # pixels of a window's row that are added at once
REGULARISATION = 1e-3  # added to the determinant, so that d is 0 where there is no texture


def solution_lanes(device: Any) -> int:
    """Pixels that these kernels compute at once on a device.

    A CPU's registers hold a run of one of the five sums, a GPU thread's all five of a pixel.
    """
    return lanes_on(device) if wp.get_device(device).is_cpu else 1


@cache
def solution_kernels(lanes: int) -> SimpleNamespace:
    """The sums over windows, and the solution."""
    Run = run_type(lanes)
    kernel = wp.kernel(module=run_module(f"{__name__}_{lanes}", CPU_FLAGS_SHALLOW), enable_backward=False)

    planes = EQUATIONS if lanes == 1 else 1
    Sum = run_type(lanes * planes)

    @wp.func
    def read(images: wp.array4d(dtype=Run), world: int, y: int, c: int, x: int) -> Sum:
        if wp.static(planes == 1):
            return images[world, y, c, x]
        pixel = Sum()
        for i in range(wp.static(planes)):
            pixel[i] = images[world, y, c + i, x][0]
        return pixel

    @wp.func
    def write(
        sums: wp.array4d(dtype=float),
        sum_runs: wp.array4d(dtype=Run),
        world: int,
        y: int,
        c: int,
        run: int,
        width: int,
        radius: int,
        value: Sum,
    ):
        if y < sums.shape[1]:
            if wp.static(planes == 1):
                sum_runs[world, y, c, run_begin(run, wp.static(lanes), width) + radius] = value
                if run == 0:
                    for k in range(radius):
                        sums[world, y, c, k] = value[0]
                if (run + 1) * wp.static(lanes) >= width:
                    for k in range(width + radius, sums.shape[3]):
                        sums[world, y, c, k] = value[wp.static(lanes - 1)]
            else:
                for i in range(wp.static(planes)):
                    sums[world, y, c + i, run] = value[i]

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

        The first and the last column are repeated beside the image: by the thread that has them on a CPU, by
        threads of their own on a GPU.
        """
        world, row, column = wp.tid()
        y = (row_begin + row) * wp.static(SUMMED_ROWS)
        height = equations_in.shape[1]
        radius = (window_in.shape[0] - wp.static(2 * SUMMED_ROWS - 1)) / 2
        count = (width + wp.static(lanes - 1)) // wp.static(lanes)
        if wp.static(planes > 1):
            count = sums_out.shape[3]
        for run in range(column, count, column_step):
            x = run_begin(run, wp.static(lanes), width)
            if wp.static(planes > 1):
                x = wp.clamp(run - radius, 0, width - 1)
            for c in range(0, wp.static(EQUATIONS), wp.static(planes)):
                sum_0 = Sum()
                sum_1 = Sum()
                sum_2 = Sum()
                sum_3 = Sum()
                weight_1 = float(0.0)
                weight_2 = float(0.0)
                weight_3 = float(0.0)
                for k in range(2 * radius + wp.static(SUMMED_ROWS)):
                    equation = read(equations_in, world, wp.clamp(y + k - radius, 0, height - 1), c, x)
                    weight_0 = window_in[k + wp.static(SUMMED_ROWS - 1)]
                    sum_0 += equation * weight_0
                    sum_1 += equation * weight_1
                    sum_2 += equation * weight_2
                    sum_3 += equation * weight_3
                    weight_3 = weight_2
                    weight_2 = weight_1
                    weight_1 = weight_0
                write(sums_out, sum_runs_out, world, y, c, run, width, radius, sum_0)
                write(sums_out, sum_runs_out, world, y + 1, c, run, width, radius, sum_1)
                write(sums_out, sum_runs_out, world, y + 2, c, run, width, radius, sum_2)
                write(sums_out, sum_runs_out, world, y + 3, c, run, width, radius, sum_3)

    @wp.func
    def sum_row(sums: wp.array4d(dtype=Run), window: wp.array(dtype=float), world: int, y: int, c: int, x: int) -> Sum:
        total = Sum()
        for k in range(0, window.shape[0], wp.static(ROW_STEP)):
            first = read(sums, world, y, c, x + k) * window[k] + read(sums, world, y, c, x + k + 1) * window[k + 1]
            second = (
                read(sums, world, y, c, x + k + 2) * window[k + 2] + read(sums, world, y, c, x + k + 3) * window[k + 3]
            )
            total += first + second
        return total

    @wp.func
    def solution(sums: wp.array4d(dtype=Run), window: wp.array(dtype=float), world: int, y: int, x: int):
        gxx = Run()
        gxy = Run()
        gyy = Run()
        hx = Run()
        hy = Run()
        if wp.static(planes == 1):
            gxx = sum_row(sums, window, world, y, 0, x)
            gxy = sum_row(sums, window, world, y, 1, x)
            gyy = sum_row(sums, window, world, y, 2, x)
            hx = sum_row(sums, window, world, y, 3, x)
            hy = sum_row(sums, window, world, y, 4, x)
        else:
            pixel = sum_row(sums, window, world, y, 0, x)
            gxx[0] = pixel[0]
            gxy[0] = pixel[1]
            gyy[0] = pixel[2]
            hx[0] = pixel[3]
            hy[0] = pixel[4]
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
