"""Checks on a dense flow image before anything is computed from it."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def count_bad_flow(
    row_begin: int,
    column_step: int,
    # In:
    flow_in: wp.array3d(dtype=wp.vec2),
    # Out:
    bad_out: wp.array2d(dtype=int),
):
    """Add up, per world and row, the pixels whose flow is not finite."""
    world, row, column = wp.tid()
    y = row_begin + row
    bad = int(0)
    for x in range(column, flow_in.shape[2], column_step):
        u = flow_in[world, y, x]
        if not (wp.isfinite(u[0]) and wp.isfinite(u[1])):
            bad += 1
    if bad > 0:
        wp.atomic_add(bad_out, world, y, bad)
