"""The visual servoing law DIJE (17) in many worlds: joint step = k_p J# (p_target - p), damped and bounded.

    step = J^T (J J^T + d^2 I)^-1 k_p (p_target - p)

over the joints that are free. A step whose largest entry is above ``max_step`` is shortened as a whole. Joints
that meet their limit stop there and the others are solved again for what is left. With d = 0 the inverse is the
pseudoinverse of J J^T. At the end a normal dither is added, from a random stream of each world's own, and the
step is held within the limits once more. Its deviation is at most the step's largest entry, so that it fades at the
target, where it would keep the point away. A thread a world; float64 inside, for J J^T squares J's condition.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

MAX_JOINTS = 32  # bits that say which joints are free
RANK_TOLERANCE = 1e-12  # ratio of J J^T's eigenvalues below which J has rank 1; float32 resolves 1e-6 in J


def servo_steps(
    jacobian: wp.array,
    points: wp.array,
    targets: wp.array,
    positions: wp.array,
    limits: wp.array,
    where: wp.array,
    seeds: wp.array,
    draws: wp.array,
    steps_out: wp.array,
    *,
    gain: float,
    damping: float,
    max_step: float,
    dither: float,
) -> None:
    """Joint steps towards image targets, in the chosen worlds.

    Args:
        jacobian: float32 ``(worlds, 2, N)``, J at the points [px/rad], N at most 32.
        points, targets: vec2d ``(worlds,)`` [px].
        positions: float32 ``(worlds, N)``, where the joints are [rad].
        limits: vec2 ``(N,)``, least and greatest position [rad]; -inf and inf where there is none.
        where: int ``(worlds,)``, not 0 in the worlds to step; the others' steps stay as they are.
        seeds: uint32 ``(worlds,)``, of the dither.
        draws: uint32 ``(worlds,)``, steps drawn so far; counted up here.
        steps_out: float32 ``(worlds, N)`` [rad].
        gain: k_p, the share of the error to remove per command.
        damping: d [px/rad].
        max_step: largest joint step [rad].
        dither: standard deviation of the joint step that is added [rad], at most the step's largest entry.

    A world whose J, point, target or positions are not numbers gets a step of zero.
    """
    worlds, rows, joints = jacobian.shape
    if rows != 2 or not 1 <= joints <= MAX_JOINTS:
        raise ValueError(f"jacobian has shape {jacobian.shape}; expected (worlds, 2, N) with N from 1 to {MAX_JOINTS}")
    wp.launch(
        servo_steps_kernel,
        dim=worlds,
        inputs=[jacobian, points, targets, positions, limits, where, seeds, gain, damping, max_step, dither],
        outputs=[draws, steps_out],
        device=jacobian.device,
    )


@wp.func
def inverse_2x2(xx: wp.float64, xy: wp.float64, yy: wp.float64, pseudo: bool) -> wp.mat22d:
    """Inverse of a symmetric matrix; with ``pseudo`` its pseudoinverse."""
    zero = wp.float64(0.0)
    half = wp.float64(0.5)
    if pseudo:
        middle = half * (xx + yy)
        spread = wp.sqrt(half * half * (xx - yy) * (xx - yy) + xy * xy)
        least = middle - spread
        greatest = middle + spread
        if greatest <= zero:
            return wp.mat22d(zero, zero, zero, zero)
        if least <= wp.float64(wp.static(RANK_TOLERANCE)) * greatest:
            # Rank 1: m m^T / |m|^4 with m m^T the matrix itself.
            scale = wp.float64(1.0) / (greatest * greatest)
            return wp.mat22d(xx * scale, xy * scale, xy * scale, yy * scale)
    scale = wp.float64(1.0) / (xx * yy - xy * xy)
    return wp.mat22d(yy * scale, -xy * scale, -xy * scale, xx * scale)


@wp.kernel
def servo_steps_kernel(
    # In:
    jacobian_in: wp.array3d(dtype=float),
    points_in: wp.array(dtype=wp.vec2d),
    targets_in: wp.array(dtype=wp.vec2d),
    positions_in: wp.array2d(dtype=float),
    limits_in: wp.array(dtype=wp.vec2),
    where_in: wp.array(dtype=int),
    seeds_in: wp.array(dtype=wp.uint32),
    gain: wp.float64,
    damping: wp.float64,
    max_step: float,
    dither: float,
    # Out:
    draws_out: wp.array(dtype=wp.uint32),
    steps_out: wp.array2d(dtype=float),
):
    """Solve, stop joints at their limits, solve again; at most N times."""
    world = wp.tid()
    if where_in[world] == 0:
        return
    joints = jacobian_in.shape[2]
    motion = (targets_in[world] - points_in[world]) * gain
    sound = wp.isfinite(motion[0]) and wp.isfinite(motion[1])
    for j in range(joints):
        steps_out[world, j] = 0.0
        sound = sound and wp.isfinite(positions_in[world, j])
        sound = sound and wp.isfinite(jacobian_in[world, 0, j]) and wp.isfinite(jacobian_in[world, 1, j])
    draw = draws_out[world]
    draws_out[world] = draw + wp.uint32(1)
    if not sound:
        return

    stopped = wp.uint32(0)
    solving = bool(True)
    while solving:
        xx = damping * damping
        xy = wp.float64(0.0)
        yy = damping * damping
        left = motion
        for j in range(joints):
            x = wp.float64(jacobian_in[world, 0, j])
            y = wp.float64(jacobian_in[world, 1, j])
            if (stopped & (wp.uint32(1) << wp.uint32(j))) == wp.uint32(0):
                xx += x * x
                xy += x * y
                yy += y * y
            else:
                left -= wp.vec2d(x, y) * wp.float64(steps_out[world, j])
        dual = inverse_2x2(xx, xy, yy, damping == wp.float64(0.0)) * left
        longest = float(0.0)
        for j in range(joints):
            if (stopped & (wp.uint32(1) << wp.uint32(j))) == wp.uint32(0):
                x = wp.float64(jacobian_in[world, 0, j])
                y = wp.float64(jacobian_in[world, 1, j])
                steps_out[world, j] = float(x * dual[0] + y * dual[1])
            longest = wp.max(longest, wp.abs(steps_out[world, j]))
        shrink = wp.where(longest > max_step, max_step / longest, 1.0)
        solving = bool(False)
        for j in range(joints):
            step = steps_out[world, j] * shrink
            bit = wp.uint32(1) << wp.uint32(j)
            if (stopped & bit) == wp.uint32(0):
                held = within_limits(step, positions_in[world, j], limits_in[j])
                if held != step:
                    stopped = stopped | bit
                    solving = True
                    step = held
            steps_out[world, j] = step

    if dither > 0.0:
        largest = float(0.0)
        for j in range(joints):
            largest = wp.max(largest, wp.abs(steps_out[world, j]))
        if largest > 0.0:
            # A stream from the seed and the count: worlds with different seeds never fall into one another's.
            state = wp.rand_init(int(seeds_in[world]), int(draw))
            deviation = wp.min(dither, largest)
            for j in range(joints):
                step = steps_out[world, j] + deviation * wp.randn(state)
                steps_out[world, j] = within_limits(step, positions_in[world, j], limits_in[j])


@wp.func
def within_limits(step: float, position: float, limits: wp.vec2) -> float:
    """Step held within a joint's limits; a joint outside of them may come back, not go further out."""
    return wp.clamp(step, wp.min(limits[0] - position, 0.0), wp.max(limits[1] - position, 0.0))


def limits_array(limits: Any, joints: int, device: Any) -> wp.array:
    """``(N, 2)`` limits as :func:`servo_steps` takes them; None for none."""
    pairs = [[float("-inf"), float("inf")]] * joints if limits is None else limits
    return wp.array(pairs, dtype=wp.vec2, device=device)
