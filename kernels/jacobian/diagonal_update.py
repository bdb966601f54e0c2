"""One frame of the filter with a variance for every pixel and joint, covariances dropped: DIJE (9) to (11)."""

from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear
from dense_vs.kernels.image.flow_field import is_flow
from dense_vs.kernels.image.row_taps import find_row_taps
from dense_vs.kernels.jacobian.moved_pixels import innovation, moved_taps

wp.set_module_options({"enable_backward": False})


def diagonal_update_kernel(types: SimpleNamespace) -> wp.Kernel:
    """The kernel for the state of :func:`.state_types.state_types`, of order 1."""
    StateImage, JointVector = types.StateImage, types.JointVector
    write_state, sample_state = types.write_state, types.sample_state
    sample_variance = bilinear(JointVector)
    joints = types.joints

    @wp.kernel(module=f"{__name__}_{types.suffix}", enable_backward=False)
    def update_diagonal(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: StateImage,
        variance_in: wp.array3d(dtype=JointVector),
        shift_in: wp.array3d(dtype=wp.vec2),  # u of DIJE (13) or J dq of DIJE (14) [px]
        iterations: int,
        places: wp.array3d(dtype=wp.int32),
        fractions: wp.array3d(dtype=wp.float32),
        move_variance: int,
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
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
        world, row, column = wp.tid()
        y = row_begin + row
        width = jacobian_in.shape[2]
        dq = dq_in[world]
        growth = process_noise * wp.dot(dq, dq) + drift_noise
        if column_step == 1:
            find_row_taps(shift_in, world, y, iterations, row_begin, places, fractions)
        for x in range(column, width, column_step):
            taps = moved_taps(shift_in, world, x, y, iterations, row_begin, column_step, places, fractions)
            prior = sample_state(jacobian_in, world, taps)
            variance = variance_in[world, y, x]
            if move_variance != 0:
                variance = sample_variance(variance_in, world, taps)
            for i in range(wp.static(joints)):
                variance[i] = wp.min(variance[i] + growth, max_variance)  # DIJE (9)
            flow = flow_in[world, y, x]
            projected = wp.cw_mul(variance, dq)
            gain = projected * (1.0 / (wp.dot(projected, dq) + measurement_noise))
            error = innovation(flow, model_flow_in, world, taps)
            write_state(jacobian_out, world, y, x, prior + wp.outer(error, gain))  # DIJE (10)
            if is_flow(flow):
                variance = variance - wp.cw_mul(gain, projected)  # DIJE (11)
            variance_out[world, y, x] = variance

    return update_diagonal
