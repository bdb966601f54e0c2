"""Where the surface point that is now at a pixel was one frame ago, DIJE (13) and (14).

Prediction moves the state image along a displacement image v: y = x - v(x), repeated as y = x - v(y). v is the
measured flow u in DIJE (13) and the predicted flow J dq in DIJE (14). Both are printed with one step; every
further step comes nearer to the fixed point y = x - v(y) (beyond the paper).
"""

import warp as wp

from dense_vs.kernels.image.bilinear import Taps, bilinear, bilinear_taps
from dense_vs.kernels.image.flow_field import finite, is_flow

wp.set_module_options({"enable_backward": False})

sample_vec2 = bilinear(wp.vec2)


@wp.func
def pixel_shift(
    image: wp.array3d(dtype=wp.vec2), world: int, x: int, y: int, iterations: int, width: int, height: int
) -> wp.vec2:
    """Shift [px] of the point now at (x, y): v(x), then v(x - v(x)), ... ``iterations`` times, 0 to 3."""
    moved = wp.vec2(0.0, 0.0)
    if iterations > 0:
        moved = image[world, y, x]
        if not finite(moved):
            return wp.vec2(0.0, 0.0)
    if iterations > 1:
        moved = sample_vec2(image, world, bilinear_taps(x, y, moved, width, height))
    if iterations > 2:
        moved = sample_vec2(image, world, bilinear_taps(x, y, moved, width, height))
    return moved


@wp.func
def moved_taps(image: wp.array3d(dtype=wp.vec2), world: int, x: int, y: int, iterations: int) -> Taps:
    """Taps for where the point now at (x, y) was."""
    width = image.shape[2]
    height = image.shape[1]
    return bilinear_taps(x, y, pixel_shift(image, world, x, y, iterations, width, height), width, height)


@wp.func
def innovation(flow: wp.vec2, model_flow: wp.array3d(dtype=wp.vec2), world: int, taps: Taps) -> wp.vec2:
    """u - J dq [px], the bracket of DIJE (10); zero where the flow is not finite, which keeps the prediction."""
    if is_flow(flow):
        return flow - sample_vec2(model_flow, world, taps)
    return wp.vec2(0.0, 0.0)
