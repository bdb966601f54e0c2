"""Image vectors as colours, DIJE Fig. 2: hue is the direction, brightness the length."""

import warp as wp

from dense_vs.kernels.image.flow_field import finite

wp.set_module_options({"enable_backward": False})


@wp.func
def channel(sextant: float, offset: float, value: float) -> wp.uint8:
    """Red (offset 5), green (3) or blue (1) of a saturated hue, given in sixths of the circle."""
    k = offset + sextant
    k = k - 6.0 * wp.floor(k / 6.0)
    return wp.uint8(value * (1.0 - wp.clamp(wp.min(k, 4.0 - k), 0.0, 1.0)) + 0.5)


@wp.kernel
def vector_colours_kernel(
    row_begin: int,
    column_step: int,
    # In:
    vectors_in: wp.array3d(dtype=wp.vec2),
    full_scale: float,  # length of full brightness
    # Out:
    rgb_out: wp.array3d(dtype=wp.vec3ub),
):
    """Red points right, hue grows clockwise; black where a vector is not finite."""
    world, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, vectors_in.shape[2], column_step):
        v = vectors_in[world, y, x]
        rgb = wp.vec3ub(wp.uint8(0), wp.uint8(0), wp.uint8(0))
        if finite(v):
            value = 255.0 * wp.min(wp.length(v) / full_scale, 1.0)
            sextant = wp.atan2(v[1], v[0]) * (3.0 / 3.14159265358979)
            rgb = wp.vec3ub(channel(sextant, 5.0, value), channel(sextant, 3.0, value), channel(sextant, 1.0, value))
        rgb_out[world, y, x] = rgb
