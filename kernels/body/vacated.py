"""Pixels that a body has left and that stand still, where J says that they move."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def vacated(
    row_begin: int,
    column_step: int,
    # In:
    body_in: wp.array3d(dtype=wp.uint8),  # (1, H, W) not 0 on the body
    near_in: wp.array3d(dtype=wp.uint8),  # not 0 on the body and beside it
    flow_in: wp.array3d(dtype=wp.vec2),  # u [px], not a number where it says nothing
    estimate_in: wp.array3d(dtype=wp.vec2),  # e, by J as it is [px]
    lately: int,  # motions since the body was there, most that count
    still: float,  # share of |e| below which u is none
    moving: float,  # |e| above which it says anything [px]
    # In and out:
    ago: wp.array3d(dtype=wp.int16),  # motions since the body was there, at most lately + 1
    # Out:
    left_out: wp.array3d(dtype=wp.uint8),
):
    """Counts a motion and marks what the body has left by it."""
    world, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, body_in.shape[2], column_step):
        since = wp.min(int(ago[world, y, x]) + 1, lately + 1)
        if body_in[world, y, x] != wp.uint8(0):
            since = 0
        ago[world, y, x] = wp.int16(since)
        left = wp.uint8(0)
        if since <= lately and near_in[world, y, x] == wp.uint8(0):
            expected = wp.length(estimate_in[world, y, x])
            if expected > moving and wp.length(flow_in[world, y, x]) < still * expected:
                left = wp.uint8(1)
        left_out[world, y, x] = left
