"""Pixels at which what moves is not what a body's model says, by sums over a window and the last motions."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def covered(
    row_begin: int,
    column_step: int,
    # In:
    off_in: wp.array3d(dtype=float),  # (1, H, W) squared motion that is not shared, summed over a window [px^2]
    moved_in: wp.array3d(dtype=float),  # all of it
    body_in: wp.array3d(dtype=wp.uint8),  # not 0 on the body
    cover_in: wp.array3d(dtype=wp.uint8),  # not 0 where the body was covered by the motion before
    decay: float,  # of the sums, from one motion to the next
    strange: float,  # share from which a pixel counts
    faint: float,  # sums below say nothing [px^2]
    longest: int,  # motions after which what is seen counts again
    # In and out:
    off_sum: wp.array3d(dtype=float),
    moved_sum: wp.array3d(dtype=float),
    since: wp.array3d(dtype=wp.int16),  # motions that each has been covered for
    # Out:
    covered_out: wp.array3d(dtype=wp.uint8),  # 0 no, 1 by this motion, 2 as before, as nothing moves
    counts_out: wp.array2d(dtype=wp.vec2i),  # (1, H) pixels of the body of which something is told, and strange ones
):
    """Adds a motion to the sums and judges every pixel, a row a thread."""
    world, row, column = wp.tid()
    y = row_begin + row
    told_on_body = int(0)
    strange_on_body = int(0)
    for x in range(column, off_in.shape[2], column_step):
        off = decay * off_sum[world, y, x] + off_in[world, y, x]
        moved = decay * moved_sum[world, y, x] + moved_in[world, y, x]
        off_sum[world, y, x] = off
        moved_sum[world, y, x] = moved
        found = int(0)
        if moved > faint:
            if off > strange * moved:
                found = 1
            else:
                since[world, y, x] = wp.int16(0)
            if body_in[world, y, x] != wp.uint8(0):
                told_on_body += 1
                strange_on_body += found
        elif cover_in[world, y, x] != wp.uint8(0):
            found = 2
        if int(since[world, y, x]) > longest:
            found = 0
        covered_out[world, y, x] = wp.uint8(found)
    counts_out[world, y] = wp.vec2i(told_on_body, strange_on_body)
