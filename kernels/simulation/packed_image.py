"""Colours, grey levels and geom ids out of a ray tracer's packed pixels."""

import warp as wp

from dense_vs.kernels.image.gray_image import luma

wp.set_module_options({"enable_backward": False})


@wp.kernel
def unpack_image_kernel(
    row_begin: int,
    column_step: int,
    # In:
    packed_in: wp.array2d[wp.uint32],  # (worlds, height width) 0xAARRGGBB
    segment_in: wp.array2d[wp.vec2i],  # (worlds, height width) object id and type
    geom_type: int,  # the object type that marks a geom
    # Out:
    rgb_out: wp.array3d[wp.vec3ub],
    ids_out: wp.array3d[int],  # geom id, -1 for none
):
    """Split packed colour into uint8 RGB, and keep the id of a segment only where it is a geom."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = ids_out.shape[2]
    for x in range(column, width, column_step):
        pixel = y * width + x
        colour = packed_in[world, pixel]
        rgb_out[world, y, x] = wp.vec3ub(
            wp.uint8((colour >> wp.uint32(16)) & wp.uint32(0xFF)),
            wp.uint8((colour >> wp.uint32(8)) & wp.uint32(0xFF)),
            wp.uint8(colour & wp.uint32(0xFF)),
        )
        segment = segment_in[world, pixel]
        ids_out[world, y, x] = wp.where(segment[1] == geom_type, segment[0], -1)


@wp.kernel
def packed_to_gray_kernel(
    row_begin: int,
    column_step: int,
    # In:
    packed_in: wp.array2d[wp.uint32],  # (worlds, height width) 0xAARRGGBB
    # Out:
    gray_out: wp.array3d[wp.uint8],
):
    """Luma of packed colour."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = gray_out.shape[2]
    for x in range(column, width, column_step):
        colour = int(packed_in[world, y * width + x])
        gray_out[world, y, x] = luma((colour >> 16) & 0xFF, (colour >> 8) & 0xFF, colour & 0xFF)
