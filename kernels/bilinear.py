"""Bilinear sampling of per-pixel vectors and matrices, the interpolate() of DIJE equations (13) to (16)."""

from functools import cache
from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@cache
def bilinear(dtype: Any) -> wp.Function:
    """Warp function sampling a ``(worlds, height, width)`` image of ``dtype`` at (x, y) - shift.

    The shift [px] is split into whole and fractional parts before the pixel is added, so a weight keeps its
    precision at the far end of a wide image. Outside the image the nearest border pixel answers:
    what comes into view is taken to move as what it comes in next to.
    """

    @wp.func
    def sample(image: wp.array3d(dtype=dtype), world: int, x: int, y: int, shift: wp.vec2, width: int, height: int):
        # Beyond the image every shift reads the border; clamping keeps the conversion to int defined.
        dx = wp.clamp(-shift[0], -float(width), float(width))
        dy = wp.clamp(-shift[1], -float(height), float(height))
        floor_x = wp.floor(dx)
        floor_y = wp.floor(dy)
        ax = dx - floor_x
        ay = dy - floor_y
        left = x + int(floor_x)
        top = y + int(floor_y)
        right = wp.clamp(left + 1, 0, width - 1)
        bottom = wp.clamp(top + 1, 0, height - 1)
        left = wp.clamp(left, 0, width - 1)
        top = wp.clamp(top, 0, height - 1)
        upper = image[world, top, left] * ((1.0 - ax) * (1.0 - ay)) + image[world, top, right] * (ax * (1.0 - ay))
        lower = image[world, bottom, left] * ((1.0 - ax) * ay) + image[world, bottom, right] * (ax * ay)
        return upper + lower

    return sample
