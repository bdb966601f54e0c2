"""One frame of the filter with a variance for every pixel and joint, covariances dropped: DIJE (9) to (11).

For a CPU; ``diagonal_single_pass.py`` is the form for a GPU.
"""

from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.pixel_runs import run_module
from dense_vs.kernels.jacobian import row_update


def diagonal_update_kernel(types: SimpleNamespace) -> wp.Kernel:
    """The kernel for the state of :func:`.state_types.state_types`, of order 1 and in matrices."""
    StateImage, JointVector = types.StateImage, types.JointVector
    diagonal_row = row_update.diagonal_row(types)

    @wp.kernel(module=run_module(f"{__name__}_{types.suffix}"), enable_backward=False)
    def update_diagonal(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: StateImage,
        variance_in: wp.array3d(dtype=JointVector),
        shift: wp.array3d(dtype=wp.vec2),  # u of DIJE (13) or J dq of DIJE (14) [px]
        finds_shift: int,  # whether ``shift`` is J dq and to be written first: an image that one iteration moves by
        iterations: int,
        move_variance: int,
        flow_in: wp.array3d(dtype=wp.vec2),
        dq_in: wp.array(dtype=JointVector),
        process_noise: float,
        drift_noise: float,
        measurement_noise: float,
        max_variance: float,
        # Out:
        jacobian_out: StateImage,
        variance_out: wp.array3d(dtype=JointVector),
    ):
        """Predict the variance by DIJE (9), correct J by DIJE (10) and the variance by DIJE (11)."""
        world, row, _ = wp.tid()
        dq = dq_in[world]
        diagonal_row(
            jacobian_in,
            variance_in,
            shift,
            finds_shift != 0,
            iterations,
            move_variance != 0,
            flow_in,
            dq,
            process_noise * wp.dot(dq, dq) + drift_noise,
            measurement_noise,
            max_variance,
            jacobian_out,
            variance_out,
            world,
            row_begin + row,
        )

    return update_diagonal
