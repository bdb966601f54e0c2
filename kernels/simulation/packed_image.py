"""Colors, gray levels and geom ids out of a ray tracer's packed pixels."""

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
    """Split packed color into uint8 RGB, and keep the id of a segment only where it is a geom."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = ids_out.shape[2]
    for x in range(column, width, column_step):
        pixel = y * width + x
        color = packed_in[world, pixel]
        rgb_out[world, y, x] = wp.vec3ub(
            wp.uint8((color >> wp.uint32(16)) & wp.uint32(0xFF)),
            wp.uint8((color >> wp.uint32(8)) & wp.uint32(0xFF)),
            wp.uint8(color & wp.uint32(0xFF)),
        )
        segment = segment_in[world, pixel]
        ids_out[world, y, x] = wp.where(segment[1] == geom_type, segment[0], -1)


@wp.kernel
def unpack_ids_kernel(
    row_begin: int,
    column_step: int,
    # In:
    segment_in: wp.array2d[wp.vec2i],  # (worlds, height width) object id and type
    geom_type: int,  # the object type that marks a geom
    # Out:
    ids_out: wp.array3d[int],  # geom id, -1 for none
):
    """Keep the id of a segment only where it is a geom."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = ids_out.shape[2]
    for x in range(column, width, column_step):
        segment = segment_in[world, y * width + x]
        ids_out[world, y, x] = wp.where(segment[1] == geom_type, segment[0], -1)


@wp.kernel
def mean_color_kernel(
    row_begin: int,
    column_step: int,
    # In:
    packed_in: wp.array2d[wp.uint32],  # (worlds, samples height samples width) 0xAARRGGBB
    samples: int,  # a pixel is the mean of samples x samples of them
    # Out:
    rgb_out: wp.array3d[wp.vec3ub],
):
    """Mean color of the packed pixels that each pixel covers, rounded."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = rgb_out.shape[2]
    count = samples * samples
    for x in range(column, width, column_step):
        red = count // 2
        green = count // 2
        blue = count // 2
        for i in range(samples):
            for j in range(samples):
                color = int(packed_in[world, (y * samples + i) * samples * width + x * samples + j])
                red += (color >> 16) & 0xFF
                green += (color >> 8) & 0xFF
                blue += color & 0xFF
        rgb_out[world, y, x] = wp.vec3ub(wp.uint8(red // count), wp.uint8(green // count), wp.uint8(blue // count))


@wp.kernel
def packed_to_gray_kernel(
    row_begin: int,
    column_step: int,
    # In:
    packed_in: wp.array2d[wp.uint32],  # (worlds, height width) 0xAARRGGBB
    place_in: wp.array[int],  # (height width,) where each pixel's color lies
    # Out:
    gray_out: wp.array3d[wp.uint8],
):
    """Luma of packed color."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = gray_out.shape[2]
    for x in range(column, width, column_step):
        color = int(packed_in[world, place_in[y * width + x]])
        gray_out[world, y, x] = luma((color >> 16) & 0xFF, (color >> 8) & 0xFF, color & 0xFF)
