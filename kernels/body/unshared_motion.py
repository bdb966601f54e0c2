"""Squared image motion that a body's model and the measured flow do not have in common, for what covers the body."""

import warp as wp

from dense_vs.kernels.image.flow_field import finite

wp.set_module_options({"enable_backward": False})


@wp.kernel
def unshared_motion(
    row_begin: int,
    column_step: int,
    # In:
    flow_in: wp.array3d(dtype=wp.vec2),  # (1, H, W) u [px], not finite where it says nothing
    model_in: wp.array3d(dtype=wp.vec2),  # p, what the joints cause by the model [px]
    estimate_in: wp.array3d(dtype=wp.vec2),  # e, by J as it is [px]
    says: float,  # share of the squared motion from which e says anything
    # Out:
    off_out: wp.array3d(dtype=float),  # |u - p|^2 or |u - e|^2, the lesser where e says anything [px^2]
    moved_out: wp.array3d(dtype=float),  # |u|^2 + |p|^2 [px^2]
):
    """Both are 0 where the flow is not finite."""
    world, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, flow_in.shape[2], column_step):
        u = flow_in[world, y, x]
        off = float(0.0)
        moved = float(0.0)
        if finite(u):
            p = model_in[world, y, x]
            e = estimate_in[world, y, x]
            off = wp.length_sq(u - p)
            moved = wp.length_sq(u) + wp.length_sq(p)
            if wp.length_sq(e) > says * wp.max(wp.length_sq(u), wp.length_sq(p)):
                off = wp.min(off, wp.length_sq(u - e))
        off_out[world, y, x] = off
        moved_out[world, y, x] = moved
