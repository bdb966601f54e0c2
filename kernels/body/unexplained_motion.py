"""What a model of a body leaves unexplained of its image motion, summed row by row: whether the model is believed."""

import warp as wp

from dense_vs.kernels.image.flow_field import finite

wp.set_module_options({"enable_backward": False})


@wp.kernel
def unexplained_motion(
    row_begin: int,
    column_step: int,
    # In:
    body_in: wp.array3d(dtype=wp.uint8),  # (1, H, W), not 0 where the model has the body
    flow_in: wp.array3d(dtype=wp.vec2),  # (1, H, W) u [px], not finite where it says nothing
    model_in: wp.array3d(dtype=wp.vec2),  # p, what the joints cause by the model [px]
    moving: float,  # length of p from which a pixel says anything [px]
    by_model: int,  # whether motion is taken to be p, and no pixel is farther off than that; else u, or ``moving``
    # In and out, beforehand 0:
    off_inout: wp.array2d(dtype=wp.float64),  # (1, H) sum of |u - p| [px]
    moved_inout: wp.array2d(dtype=wp.float64),  # of the motion [px]
    count_inout: wp.array2d(dtype=int),  # pixels that say anything
):
    """Lengths, not squares: where the flow fails it fails grossly."""
    world, row, column = wp.tid()
    y = row_begin + row
    off = wp.float64(0.0)
    moved = wp.float64(0.0)
    count = int(0)
    for x in range(column, flow_in.shape[2], column_step):
        p = model_in[world, y, x]
        u = flow_in[world, y, x]
        size = wp.length(p)
        if body_in[world, y, x] != wp.uint8(0) and size > moving and finite(p) and finite(u):
            wrong = wp.length(u - p)
            seen = wp.max(wp.length(u), moving)
            if by_model != 0:
                wrong = wp.min(wrong, size)
                seen = size
            sum = wrong + seen
            if finite(wp.vec2(sum, sum)):
                off += wp.float64(wrong)
                moved += wp.float64(seen)
                count += 1
    wp.atomic_add(off_inout, world, y, off)
    wp.atomic_add(moved_inout, world, y, moved)
    wp.atomic_add(count_inout, world, y, count)
