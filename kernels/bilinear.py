"""Bilinear sampling of per-pixel vectors and matrices, the interpolate() of DIJE equations (13) to (16)."""

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


@cache
def bilinear(dtype: Any) -> wp.Function:
    """Warp function that reads a ``(worlds, height, width)`` image of ``dtype`` with :class:`Taps`."""

    @wp.func
    def sample(image: wp.array3d(dtype=dtype), world: int, taps: Taps):
        upper = (
            image[world, taps.top, taps.left] * taps.upper_left + image[world, taps.top, taps.right] * taps.upper_right
        )
        lower = (
            image[world, taps.bottom, taps.left] * taps.lower_left
            + image[world, taps.bottom, taps.right] * taps.lower_right
        )
        return upper + lower

    return sample
