"""The covariance that all pixels share, and its Kalman gain, one small matrix a world.

With the same p0, q and r at every pixel, the covariance recursion of DIJE (9) and (11) holds no
image data: it is the same at every pixel, and so is the gain. Kept once for the image it can be the
full matrix of Qian and Su's filter instead of its diagonal, at no cost per pixel. Float64, because
variances of unexcited joints stand beside ones 1e6 times smaller.

State of second order (beyond the paper). J changes as the robot moves, by its derivative, the image Hessian
H_ij = dJ_i / dq_j = H_ji, which stays nearly constant at a point of the body. With its N (N + 1) / 2 columns
after the N of J, the state's transition and observation are

    J_i <- J_i + sum_m H_im dq_m                u = J dq - 1/2 sum_ij H_ij dq_i dq_j   (J after the step)

and the filter stays linear, with one covariance for all pixels. The transition F(dq) is the same at every pixel
too, and F(a) F(b) = F(a + b). So the image keeps J as it was at the reference posture, where the filter started;
the displacement d since then is kept once, and enters the image's pass through the regressor and the gain only:
J_i + sum_m H_im d_m is computed where J is read.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


def state_columns(joints: int, order: int) -> int:
    """Columns of the state: N of J, and N (N + 1) / 2 of H where ``order`` is 2."""
    return joints + (joints * (joints + 1) // 2 if order == 2 else 0)


@wp.func
def hessian_column(i: int, j: int, joints: int) -> int:
    """Column of H_ij = H_ji in the state: row by row of the upper triangle, after the columns of J."""
    low = wp.min(i, j)
    high = wp.max(i, j)
    return joints + low * joints - (low * (low - 1)) // 2 + (high - low)


@wp.func
def bound_scale(variance: wp.float64, max_variance: wp.float64) -> wp.float64:
    """Factor s with s^2 variance <= max_variance."""
    if variance > max_variance:
        return wp.sqrt(max_variance / variance)
    return wp.float64(1.0)


@wp.func
def column_pair(column: int, joints: int) -> wp.vec2i:
    """i <= j of the H_ij that a column past the first N holds."""
    rest = column - joints
    i = int(0)
    while rest >= joints - i:
        rest -= joints - i
        i += 1
    return wp.vec2i(i, i + rest)


@wp.func
def second_order_entry(dq: wp.array2d(dtype=wp.float32), world: int, column: int, joints: int) -> wp.float64:
    """What multiplies H_ij in 1/2 sum_ij H_ij dq_i dq_j."""
    pair = column_pair(column, joints)
    product = wp.float64(dq[world, pair[0]]) * wp.float64(dq[world, pair[1]])
    if pair[0] == pair[1]:
        product *= wp.float64(0.5)
    return product


@wp.kernel
def regressors(
    # In:
    dq_in: wp.array2d(dtype=wp.float32),
    displacement_in: wp.array2d(dtype=wp.float64),
    # Out:
    regressor_out: wp.array2d(dtype=wp.float32),
):
    """Row that predicts the flow from the image's state: u = sum_i (J_i + sum_m H_im (d + dq / 2)_m) dq_i.

    A thread a world and column.
    """
    world, column = wp.tid()
    joints = dq_in.shape[1]
    if column < joints:
        regressor_out[world, column] = dq_in[world, column]
        return
    pair = column_pair(column, joints)
    dq_i = wp.float64(dq_in[world, pair[0]])
    dq_j = wp.float64(dq_in[world, pair[1]])
    entry = (displacement_in[world, pair[1]] + wp.float64(0.5) * dq_j) * dq_i
    if pair[0] != pair[1]:
        entry += (displacement_in[world, pair[0]] + wp.float64(0.5) * dq_i) * dq_j
    regressor_out[world, column] = wp.float32(entry)


@wp.kernel
def update_shared_covariance(
    # In:
    dq_in: wp.array2d(dtype=wp.float32),
    covariance_in: wp.array3d(dtype=wp.float64),
    displacement_in: wp.array2d(dtype=wp.float64),
    process_noise: wp.float64,
    drift_noise: wp.float64,
    measurement_noise: wp.float64,
    max_variance: wp.float64,
    hessian_noise: wp.float64,
    max_hessian_variance: wp.float64,
    # Out:
    projected_out: wp.array2d(dtype=wp.float64),
    covariance_out: wp.array3d(dtype=wp.float64),
    displacement_out: wp.array2d(dtype=wp.float64),
    gain_out: wp.array2d(dtype=wp.float32),
):
    """Predict P <- F P F^T + Q, gain K = P h / (h^T P h + r), update P <- P - K (P h)^T, a thread a world.

    P is that of the present posture; the gain that goes out is F(-d) K, for the image's state.

    Q is (q |dq|^2 + q0) I for J and q_H |dq|^2 I for H. Where a variance exceeds its bound P is scaled to
    S P S with a diagonal S, which keeps it positive definite as clipping the diagonal would not.
    """
    world = wp.tid()
    joints = dq_in.shape[1]
    columns = covariance_in.shape[1]

    for i in range(columns):
        for j in range(columns):
            covariance_out[world, i, j] = covariance_in[world, i, j]
    if columns > joints:
        for i in range(joints):
            for j in range(columns):
                change = wp.float64(0.0)
                for m in range(joints):
                    row = hessian_column(i, m, joints)
                    change += covariance_out[world, row, j] * wp.float64(dq_in[world, m])
                covariance_out[world, i, j] += change
        for j in range(joints):
            for i in range(columns):
                change = wp.float64(0.0)
                for m in range(joints):
                    column = hessian_column(j, m, joints)
                    change += covariance_out[world, i, column] * wp.float64(dq_in[world, m])
                covariance_out[world, i, j] += change

    squared = wp.float64(0.0)
    for i in range(joints):
        dq = wp.float64(dq_in[world, i])
        squared += dq * dq
    for i in range(columns):
        growth = hessian_noise * squared
        bound = max_hessian_variance
        if i < joints:
            growth = process_noise * squared + drift_noise
            bound = max_variance
        covariance_out[world, i, i] += growth
        scale = bound_scale(covariance_out[world, i, i], bound)
        if scale < wp.float64(1.0):
            for j in range(columns):
                covariance_out[world, i, j] *= scale
                covariance_out[world, j, i] *= scale

    innovation_variance = measurement_noise
    for i in range(columns):
        projected = wp.float64(0.0)
        for j in range(columns):
            entry = wp.float64(0.0)
            if j < joints:
                entry = wp.float64(dq_in[world, j])
            else:
                entry = -second_order_entry(dq_in, world, j, joints)
            projected += covariance_out[world, i, j] * entry
        projected_out[world, i] = projected
        if i < joints:
            innovation_variance += projected * wp.float64(dq_in[world, i])
        else:
            innovation_variance -= projected * second_order_entry(dq_in, world, i, joints)

    for i in range(columns):
        gain = projected_out[world, i] / innovation_variance
        for j in range(columns):
            covariance_out[world, i, j] -= gain * projected_out[world, j]
    for i in range(joints):
        displacement_out[world, i] = displacement_in[world, i] + wp.float64(dq_in[world, i])
    for i in range(columns):
        gain = projected_out[world, i]
        if i < joints and columns > joints:
            for m in range(joints):
                gain -= projected_out[world, hessian_column(i, m, joints)] * displacement_out[world, m]
        gain_out[world, i] = wp.float32(gain / innovation_variance)


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
        gain_out[world, i] = wp.float32(weight * wp.float64(dq_in[world, i]) / (forgetting + weight * squared))


@wp.kernel
def forget_covariance(
    # In:
    where_in: wp.array(dtype=int),
    variance: wp.float64,
    hessian_variance: wp.float64,
    # Out:
    covariance_out: wp.array3d(dtype=wp.float64),
    displacement_out: wp.array2d(dtype=wp.float64),
):
    """The covariance at the start, at the present posture, where ``where_in`` is not 0; a thread a world."""
    world = wp.tid()
    if where_in[world] == 0:
        return
    joints = displacement_out.shape[1]
    for i in range(covariance_out.shape[1]):
        for j in range(covariance_out.shape[2]):
            covariance_out[world, i, j] = wp.float64(0.0)
        covariance_out[world, i, i] = wp.where(i < joints, variance, hessian_variance)
    for i in range(joints):
        displacement_out[world, i] = wp.float64(0.0)
