"""Image Jacobian of a robot whose passive joints p follow its commanded ones q: J = J_q + J_p dp/dq at every pixel."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def couple_jacobian_kernel(
    row_begin: int,
    column_step: int,
    # In:
    # (worlds, height, width, 2 (N + P)) px/rad, rows of x and y one after the other; 3 (N + P) with depth
    jacobian_in: wp.array4d[float],
    coupling_in: wp.array3d[float],  # (worlds, P, N) dp/dq
    # Out:
    jacobian_out: wp.array4d[float],  # (worlds, height, width, 2 N) px/rad; 3 N with depth
):
    """Columns of the commanded joints, with what the passive ones add."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = jacobian_in.shape[2]
    passive = coupling_in.shape[1]
    joints = coupling_in.shape[2]
    for x in range(column, width, column_step):
        for axis in range(jacobian_out.shape[3] // joints):
            first = axis * (joints + passive)
            for n in range(joints):
                slope = jacobian_in[world, y, x, first + n]
                for p in range(passive):
                    slope += jacobian_in[world, y, x, first + joints + p] * coupling_in[world, p, n]
                jacobian_out[world, y, x, axis * joints + n] = slope
