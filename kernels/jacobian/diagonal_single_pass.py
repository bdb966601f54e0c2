"""The form with a variance for every pixel and joint in a single pass over the image, for a GPU: DIJE (9) to (11).

As in ``single_pass_update.py``, v = J dq is computed wherever it is wanted. The variance lies in planes as the state
does, so that both are read and written by accesses of 16 bytes.
"""

from functools import cache

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear_taps
from dense_vs.kernels.image.flow_field import finite, is_flow
from dense_vs.kernels.image.tiles import tile_pixel
from dense_vs.kernels.jacobian.state_image import variance_image
from dense_vs.kernels.jacobian.state_types import state_types

wp.set_module_options({"enable_backward": False})


@cache
def diagonal_single_pass_kernel(joints: int, by_model: bool, iterations: int, move_variance: bool) -> wp.Kernel:
    """Tile kernel that does what ``predicted_flow`` and ``update_diagonal`` do, in layout ``"planes"``.

    Pixels are moved by v = J dq, iterated, with ``by_model``, else by the flow, or not at all with 0 iterations.
    """
    types = state_types(joints, 1, "planes")
    StateImage, JointVector = types.StateImage, types.JointVector
    read_state, write_state, sample_state = types.read_state, types.write_state, types.sample_state
    variances = variance_image(joints)
    VarianceImage, read_variance = variances.VarianceImage, variances.read_variance
    write_variance, sample_variance = variances.write_variance, variances.sample_variance
    module = f"{__name__}_{int(by_model)}{iterations}{int(move_variance)}_{types.suffix}"

    @wp.kernel(module=module, enable_backward=False, grid_stride=False)
    def update_once(
        # In:
        jacobian_in: StateImage,
        variance_in: VarianceImage,
        flow_in: wp.array3d(dtype=wp.vec2),
        dq_in: wp.array(dtype=JointVector),
        process_noise: float,
        drift_noise: float,
        measurement_noise: float,
        max_variance: float,
        # Out:
        jacobian_out: StateImage,
        variance_out: VarianceImage,
    ):
        """Predict the variance by DIJE (9), correct J by DIJE (10) and the variance by DIJE (11)."""
        height = jacobian_in.shape[1]
        width = jacobian_in.shape[2]
        place = tile_pixel(wp.int64(wp.tid()), height, width)
        world = place[0]
        y = place[1]
        x = place[2]
        if x >= width or y >= height:
            return
        dq = dq_in[world]
        flow = flow_in[world, y, x]
        moved = wp.vec2(0.0, 0.0)
        if wp.static(by_model):  # DIJE (14)
            moved = read_state(jacobian_in, world, y, x) * dq
            if finite(moved):
                for _ in range(wp.static(iterations - 1)):
                    moved = sample_state(jacobian_in, world, bilinear_taps(x, y, moved, width, height)) * dq
            else:
                moved = wp.vec2(0.0, 0.0)
        elif wp.static(iterations > 0) and is_flow(flow):  # DIJE (13)
            moved = flow
        taps = bilinear_taps(x, y, moved, width, height)
        prior = sample_state(jacobian_in, world, taps)
        variance = JointVector()
        if wp.static(move_variance):
            variance = sample_variance(variance_in, world, taps)
        else:
            variance = read_variance(variance_in, world, y, x)
        growth = process_noise * wp.dot(dq, dq) + drift_noise
        for i in range(wp.static(joints)):
            variance[i] = wp.min(variance[i] + growth, max_variance)  # DIJE (9)
        if is_flow(flow):
            projected = wp.cw_mul(variance, dq)
            gain = projected * (1.0 / (wp.dot(projected, dq) + measurement_noise))
            prior = prior + wp.outer(flow - prior * dq, gain)  # DIJE (10)
            variance = variance - wp.cw_mul(gain, projected)  # DIJE (11)
        write_state(jacobian_out, world, y, x, prior)
        write_variance(variance_out, world, y, x, variance)

    return update_once
