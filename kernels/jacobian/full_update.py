"""One frame of the filter with a full N x N covariance for every pixel, as Qian and Su have it."""

from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.flow_field import is_flow
from dense_vs.kernels.jacobian.moved_pixels import innovation, moved_taps

wp.set_module_options({"enable_backward": False})


def full_update_kernel(types: SimpleNamespace) -> wp.Kernel:
    """The kernel for the state of :func:`.state_types.state_types`, of order 1."""
    StateImage, JointVector, Covariance = types.StateImage, types.JointVector, types.Covariance
    write_state, sample_state = types.write_state, types.sample_state
    joints = types.joints

    @wp.kernel(module=f"{__name__}_{types.suffix}", enable_backward=False)
    def update_full(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: StateImage,
        covariance_in: wp.array3d(dtype=Covariance),
        shift_in: wp.array3d(dtype=wp.vec2),  # u of DIJE (13) or J dq of DIJE (14) [px]
        iterations: int,
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
        dq_in: wp.array(dtype=JointVector),
        process_noise: float,
        drift_noise: float,
        measurement_noise: float,
        max_variance: float,
        # Out:
        jacobian_out: StateImage,
        covariance_out: wp.array3d(dtype=Covariance),
    ):
        """Predict the covariance, then correct J and the covariance."""
        world, row, column = wp.tid()
        y = row_begin + row
        width = jacobian_in.shape[2]
        dq = dq_in[world]
        growth = process_noise * wp.dot(dq, dq) + drift_noise
        for x in range(column, width, column_step):
            taps = moved_taps(shift_in, world, x, y, iterations)
            prior = sample_state(jacobian_in, world, taps)
            covariance = covariance_in[world, y, x]
            scale = JointVector()
            for i in range(wp.static(joints)):
                covariance[i, i] = covariance[i, i] + growth
                scale[i] = wp.min(1.0, wp.sqrt(max_variance / covariance[i, i]))
            covariance = wp.cw_mul(covariance, wp.outer(scale, scale))
            flow = flow_in[world, y, x]
            projected = covariance * dq
            gain = projected * (1.0 / (wp.dot(projected, dq) + measurement_noise))
            error = innovation(flow, model_flow_in, world, taps)
            write_state(jacobian_out, world, y, x, prior + wp.outer(error, gain))
            if is_flow(flow):
                covariance = covariance - wp.outer(gain, projected)
            covariance_out[world, y, x] = covariance

    return update_full
