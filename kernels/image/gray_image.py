"""Grey images from colour: BT.601 luma in OpenCV's fixed point, so that both give the same bytes."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def luma(red: int, green: int, blue: int) -> wp.uint8:
    """0.299 R + 0.587 G + 0.114 B, weights in units of 2^-15, rounded."""
    return wp.uint8((9798 * red + 19235 * green + 3735 * blue + 16384) >> 15)


@wp.kernel
def gray_image_kernel(
    row_begin: int,
    column_step: int,
    # In:
    rgb_in: wp.array3d(dtype=wp.vec3ub),
    # Out:
    gray_out: wp.array3d(dtype=wp.uint8),
):
    """:func:`luma` of every pixel."""
    world, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, rgb_in.shape[2], column_step):
        rgb = rgb_in[world, y, x]
        gray_out[world, y, x] = luma(int(rgb[0]), int(rgb[1]), int(rgb[2]))
