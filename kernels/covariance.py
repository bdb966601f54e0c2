"""The covariance that all pixels share, and its Kalman gain, one small matrix a world.

With the same p0, q and r at every pixel, the covariance recursion of DIJE (9) and (11) holds no
image data: it is the same at every pixel, and so is the gain. Kept once for the image it can be the
full N x N matrix of Qian and Su's filter instead of its diagonal, at no cost per pixel. Float64, because
variances of unexcited joints stand beside ones 1e6 times smaller.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def bound_scale(variance: wp.float64, max_variance: wp.float64) -> wp.float64:
    """Factor s with s^2 variance <= max_variance."""
    if variance > max_variance:
        return wp.sqrt(max_variance / variance)
    return wp.float64(1.0)


@wp.kernel
def update_shared_covariance(
    # In:
    dq_in: wp.array2d(dtype=wp.float32),
    covariance_in: wp.array3d(dtype=wp.float64),
    process_noise: wp.float64,
    drift_noise: wp.float64,
    measurement_noise: wp.float64,
    max_variance: wp.float64,
    # Out:
    projected_out: wp.array2d(dtype=wp.float64),
    covariance_out: wp.array3d(dtype=wp.float64),
    gain_out: wp.array2d(dtype=wp.float32),
):
    """Predict P, compute K = P dq / (dq^T P dq + r) and update P, a thread a world.

    P grows by (q |dq|^2 + q0) I, is scaled to S P S with a diagonal S where a variance exceeds its bound
    (which keeps it positive definite, as clipping the diagonal would not), and shrinks by K (P dq)^T.
    """
    world = wp.tid()
    joints = dq_in.shape[1]

    growth = wp.float64(0.0)
    for i in range(joints):
        dq = wp.float64(dq_in[world, i])
        growth += dq * dq
    growth = process_noise * growth + drift_noise

    for i in range(joints):
        scale_i = bound_scale(covariance_in[world, i, i] + growth, max_variance)
        for j in range(joints):
            scale_j = bound_scale(covariance_in[world, j, j] + growth, max_variance)
            value = covariance_in[world, i, j]
            if i == j:
                value += growth
            covariance_out[world, i, j] = value * scale_i * scale_j

    innovation_variance = measurement_noise
    for i in range(joints):
        projected = wp.float64(0.0)
        for j in range(joints):
            projected += covariance_out[world, i, j] * wp.float64(dq_in[world, j])
        projected_out[world, i] = projected
        innovation_variance += projected * wp.float64(dq_in[world, i])

    for i in range(joints):
        gain = projected_out[world, i] / innovation_variance
        gain_out[world, i] = wp.float32(gain)
        for j in range(joints):
            covariance_out[world, i, j] -= gain * projected_out[world, j]


@wp.kernel
def fixed_gain(
    # In:
    dq_in: wp.array2d(dtype=wp.float32),
    weight: wp.float64,
    forgetting: wp.float64,
    # Out:
    gain_out: wp.array2d(dtype=wp.float32),
):
    """Gain W dq / (rho + dq^T W dq) of DIJE (12) with W = weight I, a thread a world."""
    world = wp.tid()
    squared = wp.float64(0.0)
    for i in range(dq_in.shape[1]):
        dq = wp.float64(dq_in[world, i])
        squared += dq * dq
    for i in range(dq_in.shape[1]):
        gain_out[world, i] = wp.float32(
            weight * wp.float64(dq_in[world, i]) / (forgetting + weight * squared)
        )
