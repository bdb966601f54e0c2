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


@wp.func
def is_flow(u: wp.vec2) -> bool:
    """Whether both components are numbers below 2^17 px in magnitude, eight times the side of the largest image."""
    exponent = int(0x7F800000)
    too_large = int(0x48000000)  # the bits of 2^17
    x = wp.cast(u[0], int) & exponent
    y = wp.cast(u[1], int) & exponent
    return x < too_large and y < too_large


# A plain loop over a row, which a CPU runs 16 numbers at a time; by the same bits as ``is_flow``.
_COUNT = """
    const unsigned *row = reinterpret_cast<const unsigned*>(flow.data)
        + ((size_t)world * flow.shape[1] + y) * 2 * flow.shape[2];
    int bad = 0;
    for (int x = 0; x < flow.shape[2]; ++x)
        bad += (row[2 * x] & 0x7F800000u) >= 0x48000000u || (row[2 * x + 1] & 0x7F800000u) >= 0x48000000u;
    return bad;
"""


@wp.func_native(_COUNT)
def bad_in_row(flow: wp.array3d(dtype=wp.vec2), world: int, y: int) -> int:
    """Pixels of a row that are not ``is_flow``, in a contiguous image."""
    ...


@wp.kernel
def count_bad_flow(
    row_begin: int,
    column_step: int,
    # In:
    flow_in: wp.array3d(dtype=wp.vec2),
    # Out:
    bad_out: wp.array2d(dtype=int),
):
    """Add up, per world and row, the pixels whose flow is not finite, or larger than any image."""
    world, row, column = wp.tid()
    y = row_begin + row
    bad = int(0)
    if column_step == 1:
        bad = bad_in_row(flow_in, world, y)
    elif not is_flow(flow_in[world, y, column]):
        bad = 1
    if bad > 0:
        wp.atomic_add(bad_out, world, y, bad)
