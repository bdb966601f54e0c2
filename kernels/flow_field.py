"""Checks on a dense flow image before anything is computed from it."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def finite(u: wp.vec2) -> bool:
    """Whether both components are numbers.

    By the exponent's bits: ``wp.isfinite`` is a call that spills a pixel loop's registers on a CPU, and a compiler
    that is told to assume finite arithmetic may leave it out.
    """
    exponent = int(0x7F800000)
    x = wp.cast(u[0], int) & exponent
    y = wp.cast(u[1], int) & exponent
    return x != exponent and y != exponent


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
        if not finite(flow_in[world, y, x]):
            bad += 1
    if bad > 0:
        wp.atomic_add(bad_out, world, y, bad)
