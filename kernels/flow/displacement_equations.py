"""Equations of the displacement between two polynomial expansions (Farneback 2003, section 3).

Where image 2 is image 1 displaced by d, the expansions at x and at x + d~ (d~ what is known of d) give

    A d = db    with  A = (A_1(x) + A_2(x + d~)) / 2,  db = (b_1(x) - b_2(x + d~)) / 2 + A d~

d minimises |A d - db|^2 summed over a window: (sum w A^T A) d = sum w A^T db, five sums a pixel, whose terms
are made here. In the first pixels from the image's border, where the expansions saw repeated pixels, the
equations count less.
"""

from functools import cache

import numpy as np
import warp as wp

from dense_vs.kernels.image.pixel_runs import run_begin, run_module, run_type

wp.set_module_options({"enable_backward": False})

EQUATIONS = 5  # of the symmetric A^T A: xx, xy, yy; of A^T db: x, y
BORDER_CERTAINTY = (0.14, 0.14, 0.4472, 0.4472, 0.4472)  # of the first pixels from the border, as in OpenCV


def certainty(size: int) -> np.ndarray:
    """How much the equations count along an axis of the image."""
    weights = np.ones(size, dtype=np.float32)
    count = min(len(BORDER_CERTAINTY), size)
    weights[:count] *= BORDER_CERTAINTY[:count]
    weights[size - count :] *= BORDER_CERTAINTY[:count][::-1]
    return weights


@cache
def equations_kernel(lanes: int) -> wp.Kernel:
    """Kernel of the equations of each pixel."""
    Run = run_type(lanes)
    kernel = wp.kernel(module=run_module(f"{__name__}_{lanes}"), enable_backward=False)

    @wp.func
    def interpolate(image: wp.array4d(dtype=float), world: int, top: int, left: int, c: int, weights: wp.vec4) -> float:
        return (
            weights[0] * image[world, top, c, left]
            + weights[1] * image[world, top, c, left + 1]
            + weights[2] * image[world, top + 1, c, left]
            + weights[3] * image[world, top + 1, c, left + 1]
        )

    @kernel
    def equations(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        slot_in: wp.array(dtype=int),
        restarted_in: wp.array(dtype=int),
        expansion_in: wp.array4d(dtype=float),  # (2 worlds, height, 5, width)
        expansion_runs_in: wp.array4d(dtype=Run),  # the same memory
        displacement_in: wp.array4d(dtype=Run),  # (worlds, height, 2, width) d~
        certainty_x_in: wp.array(dtype=Run),
        certainty_y_in: wp.array(dtype=float),
        # Out:
        equations_out: wp.array4d(dtype=Run),  # (worlds, height, 5, width)
    ):
        """A^T A and A^T db of each pixel."""
        world, row, column = wp.tid()
        y = row_begin + row
        worlds = expansion_in.shape[0] / 2
        height = expansion_in.shape[1]
        last_x = float(width - 1)
        last_y = float(height - 1)
        first = slot_in[0] * worlds + world
        second = first
        if restarted_in[world] == 0:
            second = (1 - slot_in[0]) * worlds + world
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            dx = displacement_in[world, y, 0, x]
            dy = displacement_in[world, y, 1, x]
            bx = Run()
            by = Run()
            axx2 = Run()
            ayy2 = Run()
            axy2 = Run()
            inside = Run()
            for i in range(wp.static(lanes)):
                px = float(x + i) + dx[i]
                py = float(y) + dy[i]
                qx = wp.clamp(px, 0.0, last_x)
                qy = wp.clamp(py, 0.0, last_y)
                inside[i] = wp.where(px == qx and py == qy, 1.0, 0.0)
                left = wp.clamp(int(qx), 0, width - 2)
                top = wp.clamp(int(qy), 0, height - 2)
                fx = qx - float(left)
                fy = qy - float(top)
                both = fx * fy
                weights = wp.vec4(1.0 - fx - fy + both, fx - both, fy - both, both)
                bx[i] = interpolate(expansion_in, second, top, left, 0, weights)
                by[i] = interpolate(expansion_in, second, top, left, 1, weights)
                axx2[i] = interpolate(expansion_in, second, top, left, 2, weights)
                ayy2[i] = interpolate(expansion_in, second, top, left, 3, weights)
                axy2[i] = interpolate(expansion_in, second, top, left, 4, weights)
            # Where x + d~ lies outside, image 2 does not count.
            axx = expansion_runs_in[first, y, 2, x]
            ayy = expansion_runs_in[first, y, 3, x]
            axy = expansion_runs_in[first, y, 4, x]
            bx = expansion_runs_in[first, y, 0, x] - wp.cw_mul(inside, bx)
            by = expansion_runs_in[first, y, 1, x] - wp.cw_mul(inside, by)
            axx += axx + wp.cw_mul(inside, axx2 - axx)
            ayy += ayy + wp.cw_mul(inside, ayy2 - ayy)
            axy += axy + wp.cw_mul(inside, axy2 - axy)
            weight = certainty_x_in[x] * (0.5 * certainty_y_in[y])
            axx = wp.cw_mul(axx, weight)
            ayy = wp.cw_mul(ayy, weight)
            axy = wp.cw_mul(axy, weight) * 0.5
            hx = wp.cw_mul(bx, weight) + wp.cw_mul(axx, dx) + wp.cw_mul(axy, dy)
            hy = wp.cw_mul(by, weight) + wp.cw_mul(axy, dx) + wp.cw_mul(ayy, dy)
            squared = wp.cw_mul(axy, axy)
            equations_out[world, y, 0, x] = wp.cw_mul(axx, axx) + squared
            equations_out[world, y, 1, x] = wp.cw_mul(axy, axx + ayy)
            equations_out[world, y, 2, x] = wp.cw_mul(ayy, ayy) + squared
            equations_out[world, y, 3, x] = wp.cw_mul(axx, hx) + wp.cw_mul(axy, hy)
            equations_out[world, y, 4, x] = wp.cw_mul(axy, hx) + wp.cw_mul(ayy, hy)

    return equations
