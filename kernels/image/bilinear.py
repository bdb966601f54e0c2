"""Bilinear sampling of per-pixel vectors and matrices, the interpolate() of DIJE equations (13) to (16)."""

import math
from functools import cache
from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Taps:
    """Where four neighbouring pixels lie and what each counts."""

    left: int
    top: int
    right: int
    bottom: int
    upper_left: float
    upper_right: float
    lower_left: float
    lower_right: float


@wp.func
def bilinear_taps(x: int, y: int, shift: wp.vec2, width: int, height: int) -> Taps:
    """Taps for the place (x, y) - shift.

    The shift [px] is split into whole and fractional parts before the pixel is added, so a weight keeps its
    precision at the far end of a wide image. Outside the image the nearest border pixel answers:
    what comes into view is taken to move as what it comes in next to.
    """
    # Beyond the image every shift reads the border; clamping keeps the conversion to int defined.
    dx = wp.clamp(-shift[0], -float(width), float(width))
    dy = wp.clamp(-shift[1], -float(height), float(height))
    floor_x = wp.floor(dx)
    floor_y = wp.floor(dy)
    ax = dx - floor_x
    ay = dy - floor_y
    left = x + int(floor_x)
    top = y + int(floor_y)
    taps = Taps()
    taps.left = wp.clamp(left, 0, width - 1)
    taps.top = wp.clamp(top, 0, height - 1)
    taps.right = wp.clamp(left + 1, 0, width - 1)
    taps.bottom = wp.clamp(top + 1, 0, height - 1)
    taps.upper_left = (1.0 - ax) * (1.0 - ay)
    taps.upper_right = ax * (1.0 - ay)
    taps.lower_left = (1.0 - ax) * ay
    taps.lower_right = ax * ay
    return taps


# In the machine's own terms, as Warp looks up the array's strides for every element: half the time of a pixel's pass on
# a CPU. Arithmetic and its order are those of the four taps written out.
_SAMPLE = """
    const int width = image.shape[2];
    const size_t world_begin = (size_t)world * image.shape[1] * width;
    const float *pixels = reinterpret_cast<const float*>(image.data + world_begin);
    const float *upper_left = pixels + (size_t)(taps.top * width + taps.left) * %(size)d;
    const float *upper_right = pixels + (size_t)(taps.top * width + taps.right) * %(size)d;
    const float *lower_left = pixels + (size_t)(taps.bottom * width + taps.left) * %(size)d;
    const float *lower_right = pixels + (size_t)(taps.bottom * width + taps.right) * %(size)d;
    %(type)s sampled;
    float *out = reinterpret_cast<float*>(&sampled);
    for (int i = 0; i < %(size)d; ++i)
        out[i] = (upper_left[i] * taps.upper_left + upper_right[i] * taps.upper_right)
            + (lower_left[i] * taps.lower_left + lower_right[i] * taps.lower_right);
    return sampled;
"""


@cache
def bilinear(dtype: Any) -> wp.Function:
    """Warp function that reads a contiguous ``(worlds, height, width)`` image of ``dtype``, a float32 vector or
    matrix, with :class:`Taps`.
    """
    shape = dtype._shape_
    kind = "vec_t" if len(shape) == 1 else "mat_t"
    native = {"size": math.prod(shape), "type": f"wp::{kind}<{', '.join(map(str, shape))}, wp::float32>"}

    @wp.func_native(_SAMPLE % native)
    def sample(image: wp.array3d(dtype=dtype), world: int, taps: Taps) -> dtype: ...

    return sample
