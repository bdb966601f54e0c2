"""How a camera gathers light over time, and what its sensor makes of it.

The scene is rendered at several instants of an exposure; every row of the image takes its own share of them, as its
exposure begins when its turn comes. What has been gathered is then scaled, darkened toward the corners and made noisy.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def rotation_vector(rotation: wp.mat33) -> wp.vec3:
    """Axis times angle [rad] of a rotation by less than half a turn."""
    q = wp.quat_from_matrix(rotation)
    v = wp.vec3(q[0], q[1], q[2])
    length = wp.length(v)
    if length == 0.0:
        return v
    return v * (2.0 * wp.atan2(length, q[3]) / length)


@wp.kernel
def carried_poses_kernel(
    # In:
    frames: float,  # how far to carry on, 0 for the present
    position_in: wp.array2d[wp.vec3],  # (worlds, K) present
    rotation_in: wp.array2d[wp.mat33],
    previous_position_in: wp.array2d[wp.vec3],  # of one frame ago
    previous_rotation_in: wp.array2d[wp.mat33],
    # Out:
    position_out: wp.array2d[wp.vec3],
    rotation_out: wp.array2d[wp.mat33],
):
    """Poses some part of a frame before or after the present, in the motion of the last frame."""
    world, k = wp.tid()
    p = position_in[world, k]
    R = rotation_in[world, k]
    position_out[world, k] = p + (p - previous_position_in[world, k]) * frames
    turn = rotation_vector(R @ wp.transpose(previous_rotation_in[world, k])) * frames
    angle = wp.length(turn)
    if angle > 0.0:
        R = wp.quat_to_matrix(wp.quat_from_axis_angle(turn / angle, angle)) @ R
    rotation_out[world, k] = R


@wp.kernel
def gather_light_kernel(
    row_begin: int,
    column_step: int,
    # In:
    packed_in: wp.array2d[wp.uint32],  # (worlds, height width) 0xAARRGGBB
    weight_in: wp.array[float],  # (height,) share of each row's light that comes at this instant
    # In and out:
    light: wp.array3d[wp.vec3],  # (worlds, height, width) gathered so far, levels of 255
):
    """Add one instant's share of light to the rows that are exposed then."""
    world, row, column = wp.tid()
    y = row_begin + row
    weight = weight_in[y]
    if weight == 0.0:
        return
    width = light.shape[2]
    for x in range(column, width, column_step):
        color = int(packed_in[world, y * width + x])
        level = wp.vec3(float((color >> 16) & 0xFF), float((color >> 8) & 0xFF), float(color & 0xFF))
        light[world, y, x] = light[world, y, x] + level * weight


@wp.kernel
def develop_kernel(
    row_begin: int,
    column_step: int,
    # In:
    light_in: wp.array3d[wp.vec3],  # (worlds, height, width) levels of 255
    time_in: wp.array[float],  # (worlds,) s
    seed_in: wp.array[int],  # (worlds,)
    frame_seconds: float,
    flicker: float,  # standard deviation of the exposure, a share
    vignette: float,  # share of the light that the corners lose
    noise: float,  # standard deviation [levels]
    # Out:
    rgb_out: wp.array3d[wp.vec3ub],
):
    """Levels of the sensor, rounded; noise and flicker are the same whenever the same frame is asked for."""
    world, row, column = wp.tid()
    y = row_begin + row
    height = rgb_out.shape[1]
    width = rgb_out.shape[2]
    state = wp.rand_init(seed_in[world], int(wp.round(time_in[world] / frame_seconds)))
    gain = wp.max(0.0, 1.0 + flicker * wp.randn(state))
    seed = wp.randi(state)
    v = 2.0 * float(y) / float(wp.max(height - 1, 1)) - 1.0
    for x in range(column, width, column_step):
        u = 2.0 * float(x) / float(wp.max(width - 1, 1)) - 1.0
        level = light_in[world, y, x] * (gain * (1.0 - 0.5 * vignette * (u * u + v * v)))
        if noise > 0.0:
            of_pixel = wp.rand_init(seed, y * width + x)
            grain = noise * wp.randn(of_pixel)
            level = level + wp.vec3(grain, grain, grain)
        rgb_out[world, y, x] = wp.vec3ub(rounded(level[0]), rounded(level[1]), rounded(level[2]))


@wp.func
def rounded(level: float) -> wp.uint8:
    """Nearest whole level of 0 to 255."""
    return wp.uint8(wp.clamp(wp.rint(level), 0.0, 255.0))
