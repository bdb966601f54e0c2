"""Polynomial expansion of images (G. Farneback, "Two-frame motion estimation based on polynomial expansion", 2003).

Around each pixel the image is taken as f(d) = c + b^T d + d^T A d. The coefficients minimise the squared error
weighted by a Gaussian g ("applicability"). With m_ij the sum of g f x^i y^j over the neighbourhood, and because
all odd moments of g vanish, they are

    b_x = m_10 / s2        A_xx = (m_20 - s2 m_00) / (s4 - s2^2)        A_xy + A_yx = m_11 / s2^2

(likewise y), with s2 and s4 the second and fourth moment of the one-dimensional g. (The 4 x 4 system of 1, x^2,
y^2 and xy is solved by these, as the two-dimensional g is the product of two one-dimensional ones that sum to 1.)
The moments are separable: three sums along columns, then six along rows.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import warp as wp

from dense_vs.kernels.image.pixel_runs import run_begin, run_module, run_type

wp.set_module_options({"enable_backward": False})

COEFFICIENTS = 5  # b_x, b_y, A_xx, A_yy, A_xy + A_yx


def applicability(radius: int, sigma: float) -> tuple[np.ndarray, wp.vec3]:
    """Weights of the moments of order 0, 1 and 2, shape (3, radius + 1), and what turns moments into coefficients.

    The second value holds 1 / s2, 1 / (s4 - s2^2) and s2.
    """
    x = np.arange(-radius, radius + 1)
    g = np.exp(-(x**2) / (2 * sigma**2))
    g /= g.sum()
    s2, s4 = (g * x**2).sum(), (g * x**4).sum()
    weights = np.stack([g, x * g, x**2 * g])[:, radius:]
    return weights.astype(np.float32), wp.vec3(1 / s2, 1 / (s4 - s2**2), s2)


@cache
def expansion_kernels(lanes: int) -> SimpleNamespace:
    """The two passes of the expansion."""
    Run = run_type(lanes)

    kernel = wp.kernel(module=run_module(f"{__name__}_{lanes}"), enable_backward=False)

    @kernel
    def column_moments(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        weights_in: wp.array2d(dtype=float),  # (3, radius + 1)
        image_in: wp.array3d(dtype=Run),  # (worlds, height + 2 radius, width)
        # Out:
        moments_out: wp.array4d(dtype=Run),  # (worlds, height, 3, width)
    ):
        """Sums of f, y f and y^2 f down each column."""
        world, row, column = wp.tid()
        y = row_begin + row
        radius = weights_in.shape[1] - 1
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            m0 = image_in[world, y + radius, x] * weights_in[0, 0]
            m1 = Run()
            m2 = Run()
            for k in range(1, radius + 1):
                above = image_in[world, y + radius - k, x]
                below = image_in[world, y + radius + k, x]
                total = below + above
                m0 += total * weights_in[0, k]
                m1 += (below - above) * weights_in[1, k]
                m2 += total * weights_in[2, k]
            moments_out[world, y, 0, x] = m0
            moments_out[world, y, 1, x] = m1
            moments_out[world, y, 2, x] = m2

    @kernel
    def expansion(
        row_begin: int,
        column_step: int,
        # In:
        width: int,
        weights_in: wp.array2d(dtype=float),
        scale: wp.vec3,
        moments_in: wp.array4d(dtype=Run),  # (worlds, height, 3, width + 2 radius)
        slot_in: wp.array(dtype=int),
        # Out:
        expansion_out: wp.array4d(dtype=Run),  # (2 worlds, height, 5, width)
    ):
        """Coefficients from the moments along rows of the column moments, written to the worlds of a slot."""
        world, row, column = wp.tid()
        y = row_begin + row
        radius = weights_in.shape[1] - 1
        target = slot_in[0] * (expansion_out.shape[0] / 2) + world
        for run in range(column, (width + wp.static(lanes - 1)) // wp.static(lanes), column_step):
            x = run_begin(run, wp.static(lanes), width)
            centre = x + radius
            f = moments_in[world, y, 0, centre]
            m00 = f * weights_in[0, 0]
            m01 = moments_in[world, y, 1, centre] * weights_in[0, 0]
            m02 = moments_in[world, y, 2, centre] * weights_in[0, 0]
            m10 = Run()
            m20 = Run()
            m11 = Run()
            for k in range(1, radius + 1):
                g0 = weights_in[0, k]
                g1 = weights_in[1, k]
                left = moments_in[world, y, 0, centre - k]
                right = moments_in[world, y, 0, centre + k]
                total = right + left
                m00 += total * g0
                m10 += (right - left) * g1
                m20 += total * weights_in[2, k]
                left = moments_in[world, y, 1, centre - k]
                right = moments_in[world, y, 1, centre + k]
                m01 += (right + left) * g0
                m11 += (right - left) * g1
                m02 += (moments_in[world, y, 2, centre + k] + moments_in[world, y, 2, centre - k]) * g0
            mean = m00 * scale[2]
            expansion_out[target, y, 0, x] = m10 * scale[0]
            expansion_out[target, y, 1, x] = m01 * scale[0]
            expansion_out[target, y, 2, x] = (m20 - mean) * scale[1]
            expansion_out[target, y, 3, x] = (m02 - mean) * scale[1]
            expansion_out[target, y, 4, x] = m11 * (scale[0] * scale[0])

    return SimpleNamespace(column_moments=column_moments, expansion=expansion)
