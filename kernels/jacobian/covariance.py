"""The covariance that all pixels share, and its Kalman gain, one small matrix a world.

With the same p0, q and r at every pixel, the covariance recursion of DIJE (9) and DIJE (11) depends on no
image data: it is the same at every pixel, and so is the gain. Kept once for the image it can be the
full matrix of Qian and Su's filter instead of its diagonal, at no cost per pixel. Float64, because
variances of unexcited joints stand beside ones 1e6 times smaller.

State of second order (beyond the paper). J changes as the robot moves, by its derivative, the image Hessian
H_ij = dJ_i / dq_j = H_ji, which stays nearly constant at a point of the body. With its N (N + 1) / 2 columns
after the N of J, the state's transition and observation are

    J_i <- J_i + sum_m H_im dq_m                u = J s - 1/2 sum_ij H_ij s_i s_j   (J after the step)

with s the joint displacement that the flow spans: dq, more where the flow's first image lies further back, 0 where
nothing was measured.

and the filter stays linear, with one covariance for all pixels. The transition F(dq) is the same at every pixel
too, and F(a) F(b) = F(a + b). So the image keeps J as it was at the reference posture, where the filter started;
the displacement d since then is kept once, and enters the image's pass through the regressor and the gain only:
J_i + sum_m H_im d_m is computed where J is read.

Joints in units of their own. The covariance and its noises belong to joints whose typical steps are alike. A joint
of another unit (counts, degrees, 0 to 1) enters with a factor a on its step: the covariance is that of J / a, the
image's state stays in px per the joint's own unit, and the gain that goes out is K_i a_i for J, K_ij a_i a_j for H.
With a = 0 a joint is left out: its columns stay as they are, and the others' are what they would be without it.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


def state_columns(joints: int, order: int) -> int:
    """Columns of the state: N of J, and N (N + 1) / 2 of H where ``order`` is 2."""
    return joints + (joints * (joints + 1) // 2 if order == 2 else 0)


def hessian_place(i: int, j: int, joints: int) -> int:
    """Column of H_ij = H_ji in the state, on the host; as :func:`hessian_column`."""
    low, high = min(i, j), max(i, j)
    return joints + low * joints - low * (low - 1) // 2 + high - low


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
def standard_step(
    step: wp.array2d(dtype=wp.float32), factor: wp.array2d(dtype=wp.float64), world: int, joint: int
) -> wp.float64:
    """A joint's step in the units that the covariance is kept in."""
    return wp.float64(step[world, joint]) * factor[world, joint]


@wp.func
def column_factor(factor: wp.array2d(dtype=wp.float64), world: int, column: int, joints: int) -> wp.float64:
    """Factor that turns a column of the state from standard units to the joints' own."""
    if column < joints:
        return factor[world, column]
    pair = column_pair(column, joints)
    return factor[world, pair[0]] * factor[world, pair[1]]


@wp.func
def second_order_entry(
    span: wp.array2d(dtype=wp.float32), factor: wp.array2d(dtype=wp.float64), world: int, column: int, joints: int
) -> wp.float64:
    """Factor of H_ij in 1/2 sum_ij H_ij s_i s_j, all in standard units."""
    pair = column_pair(column, joints)
    product = standard_step(span, factor, world, pair[0]) * standard_step(span, factor, world, pair[1])
    if pair[0] == pair[1]:
        product *= wp.float64(0.5)
    return product


@wp.kernel
def regressors(
    # In:
    dq_in: wp.array2d(dtype=wp.float32),
    span_in: wp.array2d(dtype=wp.float32),
    displacement_in: wp.array2d(dtype=wp.float64),
    # Out:
    regressor_out: wp.array2d(dtype=wp.float32),
):
    """Row that predicts from the image's state the flow of a span s that ends with the step dq:

    u = sum_i (J_i + sum_m H_im (d + dq - s / 2)_m) s_i. A thread a world and column.
    """
    world, column = wp.tid()
    joints = dq_in.shape[1]
    if column < joints:
        regressor_out[world, column] = span_in[world, column]
        return
    pair = column_pair(column, joints)
    half = wp.float64(0.5)
    s_i = wp.float64(span_in[world, pair[0]])
    s_j = wp.float64(span_in[world, pair[1]])
    entry = (displacement_in[world, pair[1]] + wp.float64(dq_in[world, pair[1]]) - half * s_j) * s_i
    if pair[0] != pair[1]:
        entry += (displacement_in[world, pair[0]] + wp.float64(dq_in[world, pair[0]]) - half * s_i) * s_j
    regressor_out[world, column] = wp.float32(entry)


@wp.kernel
def update_shared_covariance(
    # In:
    dq_in: wp.array2d(dtype=wp.float32),
    span_in: wp.array2d(dtype=wp.float32),  # joint displacement that the flow spans; with zeros P is predicted only
    covariance_in: wp.array3d(dtype=wp.float64),
    displacement_in: wp.array2d(dtype=wp.float64),
    factor_in: wp.array2d(dtype=wp.float64),
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
    """Predict P <- F P F^T + Q, DIJE (9) and (11) in full: gain K = P h / (h^T P h + r), P <- P - K (P h)^T.

    A thread a world.

    P is that of the present posture, in standard units; the gain that goes out is F(-d) K in the joints' own, for
    the image's state.

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
                    change += covariance_out[world, row, j] * standard_step(dq_in, factor_in, world, m)
                covariance_out[world, i, j] += change
        for j in range(joints):
            for i in range(columns):
                change = wp.float64(0.0)
                for m in range(joints):
                    column = hessian_column(j, m, joints)
                    change += covariance_out[world, i, column] * standard_step(dq_in, factor_in, world, m)
                covariance_out[world, i, j] += change

    squared = wp.float64(0.0)
    for i in range(joints):
        dq = standard_step(dq_in, factor_in, world, i)
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

    # Rounding over a large step leaves entries that no covariance has: |P_ij| <= sqrt(P_ii P_jj).
    for i in range(columns):
        covariance_out[world, i, i] = wp.max(covariance_out[world, i, i], wp.float64(0.0))
    for i in range(columns):
        for j in range(columns):
            if i != j:
                most = wp.sqrt(covariance_out[world, i, i] * covariance_out[world, j, j])
                covariance_out[world, i, j] = wp.clamp(covariance_out[world, i, j], -most, most)

    innovation_variance = measurement_noise
    for i in range(columns):
        projected = wp.float64(0.0)
        for j in range(columns):
            entry = wp.float64(0.0)
            if j < joints:
                entry = standard_step(span_in, factor_in, world, j)
            else:
                entry = -second_order_entry(span_in, factor_in, world, j, joints)
            projected += covariance_out[world, i, j] * entry
        projected_out[world, i] = projected
        if i < joints:
            innovation_variance += projected * standard_step(span_in, factor_in, world, i)
        else:
            innovation_variance -= projected * second_order_entry(span_in, factor_in, world, i, joints)

    innovation_variance = wp.max(innovation_variance, measurement_noise)
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
                displacement = displacement_out[world, m] * factor_in[world, m]
                gain -= projected_out[world, hessian_column(i, m, joints)] * displacement
        gain_out[world, i] = wp.float32(gain * column_factor(factor_in, world, i, joints) / innovation_variance)


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
