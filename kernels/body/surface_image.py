"""The image of a body's surface points at a posture: which one is in front at every pixel, and how it moves there.

Product of exponentials, Gothoskar (6), takes every point to the camera; a depth image by atomic minimum and a second
pass leave the point that is in front at each pixel (beyond the papers). J is the interaction matrix times the joints'
screws. A launch with atomics is one thread's on a CPU, as Warp's are none there.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

NEAREST = wp.constant(1.0e-6)  # points at or behind the camera are left out
FARTHEST = wp.constant(3.0e38)
NONE = wp.constant(2147483647)
BORDER = 2.0  # squared distance from the middle, in those of a corner, beyond which the lens's bend no longer grows
SIDES = wp.constant(4)  # of eight, on which a pixel between points has points


@wp.func
def bent(away: wp.vec2, bend: float, corner: float) -> wp.vec2:
    """Where what a pinhole shows so far from the middle is seen from there, :meth:`.Lens.bent` [px]."""
    return (1.0 + bend * wp.min(wp.length_sq(away) / (corner * corner), BORDER)) * away


@wp.func
def bent_motion(away: wp.vec2, motion: wp.vec2, bend: float, corner: float) -> wp.vec2:
    """Derivative of :func:`bent` in the direction of a motion."""
    square = wp.length_sq(away) / (corner * corner)
    seen = (1.0 + bend * wp.min(square, BORDER)) * motion
    if square < BORDER:
        seen += (2.0 * bend / (corner * corner) * wp.dot(away, motion)) * away
    return seen


@wp.kernel
def place_surface(
    begin: int,
    # In:
    point_in: wp.array(dtype=wp.vec3),  # (P,) in the home posture
    link_in: wp.array(dtype=int),  # (P,)
    rotation_in: wp.array(dtype=wp.mat33),  # (links,) since the home posture
    translation_in: wp.array(dtype=wp.vec3),  # (links,)
    focal: float,  # [px]
    center: wp.vec2,  # [px]
    bend: float,  # of the lens
    corner: float,  # distance of the image's corners from the center [px]
    height: int,
    width: int,
    # Out:
    position_out: wp.array(dtype=wp.vec3),  # (P,) in the camera frame
    pixel_out: wp.array(dtype=wp.vec2i),  # (P,) x, y; -1 outside of the image
):
    """Positions of the points from ``begin`` on, and the pixels that they fall on."""
    i = begin + wp.tid()
    link = link_in[i]
    p = rotation_in[link] @ point_in[i] + translation_in[link]
    position_out[i] = p
    pixel_out[i] = wp.vec2i(-1, -1)
    if not p[2] > NEAREST:
        return
    place = center + bent((focal / p[2]) * wp.vec2(p[0], p[1]), bend, corner)
    inside = place[0] > -0.5 and place[1] > -0.5
    if inside and place[0] < float(width) - 0.5 and place[1] < float(height) - 0.5:
        pixel_out[i] = wp.vec2i(int(wp.rint(place[0])), int(wp.rint(place[1])))


@wp.kernel
def take_depth(
    # In:
    position_in: wp.array(dtype=wp.vec3),  # (P,)
    pixel_in: wp.array(dtype=wp.vec2i),  # (P,)
    # Out:
    depth_out: wp.array2d(dtype=float),  # (H, W) of the nearest point, beforehand FARTHEST
):
    """The depth of the nearest point at each pixel."""
    i = wp.tid()
    pixel = pixel_in[i]
    if pixel[0] >= 0:
        wp.atomic_min(depth_out, pixel[1], pixel[0], position_in[i][2])


@wp.kernel
def take_front(
    # In:
    position_in: wp.array(dtype=wp.vec3),  # (P,)
    pixel_in: wp.array(dtype=wp.vec2i),  # (P,)
    depth_in: wp.array2d(dtype=float),  # (H, W)
    # Out:
    front_out: wp.array2d(dtype=int),  # (H, W) index of a point, beforehand NONE
):
    """The point in front at each pixel, of those at one depth the first."""
    i = wp.tid()
    pixel = pixel_in[i]
    if pixel[0] >= 0 and position_in[i][2] == depth_in[pixel[1], pixel[0]]:
        wp.atomic_min(front_out, pixel[1], pixel[0], i)


@wp.func
def any_beside(front: wp.array2d(dtype=int), y: int, x: int) -> bool:
    """Whether any of five neighbors is a point: else there are fewer than four of eight, as in most of an image."""
    found = int(0)
    if y > 0 and x > 0 and x < front.shape[1] - 1:
        found = wp.min(front[y, x - 1], front[y, x + 1])
        found = wp.min(found, wp.min(front[y - 1, x - 1], wp.min(front[y - 1, x], front[y - 1, x + 1])))
    return found != NONE


@wp.func
def nearest_beside(position: wp.array(dtype=wp.vec3), front: wp.array2d(dtype=int), y: int, x: int, none: int) -> int:
    """The nearest of the points beside a pixel, where there are some on enough sides."""
    sides = int(0)
    nearest = float(FARTHEST)
    nearest_point = int(NONE)
    for k in range(9):
        v = y + k // 3 - 1
        u = x + k % 3 - 1
        if v >= 0 and v < front.shape[0] and u >= 0 and u < front.shape[1]:
            point = front[v, u]
            if point != NONE:
                sides += 1
                depth = position[point][2]
                if depth < nearest:
                    nearest = depth
                    nearest_point = point
    if sides < SIDES:
        nearest_point = none
    return nearest_point


@wp.kernel
def fill_between(
    row_begin: int,
    column_step: int,
    # In:
    position_in: wp.array(dtype=wp.vec3),  # (P,)
    front_in: wp.array2d(dtype=int),  # (H, W)
    none: int,  # what is written where there is no point
    # Out:
    front_out: wp.array2d(dtype=int),  # (H, W)
):
    """Pixels with points on at least four of eight sides take the nearest of these."""
    _, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, front_in.shape[1], column_step):
        found = front_in[y, x]
        if found == NONE:
            found = none
            if any_beside(front_in, y, x):
                found = nearest_beside(position_in, front_in, y, x, none)
        front_out[y, x] = found


@wp.func
def image_motion(velocity: wp.vec3, p: wp.vec3, focal: float, bend: float, corner: float) -> wp.vec2:
    """Motion in the image of a point that moves, the interaction matrix times its velocity."""
    scale = focal / p[2]
    motion = scale * wp.vec2(velocity[0] - p[0] / p[2] * velocity[2], velocity[1] - p[1] / p[2] * velocity[2])
    return bent_motion(scale * wp.vec2(p[0], p[1]), motion, bend, corner)


@wp.func
def screw_motion(axis: wp.vec3, moment: wp.vec3, p: wp.vec3, focal: float, bend: float, corner: float) -> wp.vec2:
    """Motion in the image of a point that a screw moves."""
    return image_motion(wp.cross(axis, p) + moment, p, focal, bend, corner)


@wp.kernel
def surface_motion(
    row_begin: int,
    column_step: int,
    # In:
    front_in: wp.array2d(dtype=int),  # (H, W) index of a point, negative off the body
    position_in: wp.array(dtype=wp.vec3),  # (P,) in the camera frame
    link_in: wp.array(dtype=int),  # (P,)
    turn_in: wp.array(dtype=wp.vec3),  # (links,) the sum of the screws that move each, times their joints' steps
    shift_in: wp.array(dtype=wp.vec3),  # (links,) the same of their moments
    focal: float,  # [px]
    bend: float,  # of the lens
    corner: float,  # distance of the image's corners from the center [px]
    # Out:
    motion_out: wp.array2d(dtype=wp.vec2),  # (H, W) [px], 0 off the body
):
    """J dq of what is in front at each pixel."""
    _, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, front_in.shape[1], column_step):
        point = front_in[y, x]
        motion = wp.vec2(0.0, 0.0)
        if point >= 0:
            link = link_in[point]
            motion = screw_motion(turn_in[link], shift_in[link], position_in[point], focal, bend, corner)
        motion_out[y, x] = motion


@wp.func
def depth_change(
    along: float,
    by_depth: float,
    apart: float,
    size: float,
    depth_deviation: float,
    noise_scale: float,
    least_noise: float,
) -> float:
    """Share of inverse depth by which another J has a point nearer, a mean by variances; 0 where it says none.

    Sums over J's entries: ``along`` of the other J less the point's, times what goes with inverse depth, ``by_depth``
    of that squared, ``apart`` of the difference squared, ``size`` of J squared.
    """
    change = float(0.0)
    if by_depth > 0.0:
        unexplained = wp.max(apart - along * along / by_depth, 0.0)
        noise = noise_scale * noise_scale * unexplained + least_noise * least_noise * size
        change = along / (by_depth + noise / (depth_deviation * depth_deviation))
        if not wp.abs(change) < 1.0:  # at most to twice the inverse depth or none; not of what overflows
            change = 0.0
    return change


@wp.kernel
def surface_jacobian(
    row_begin: int,
    column_step: int,
    # In:
    front_in: wp.array2d(dtype=int),  # (H, W) index of a point, negative off the body
    position_in: wp.array(dtype=wp.vec3),  # (P,) in the camera frame
    link_in: wp.array(dtype=int),  # (P,)
    axis_in: wp.array(dtype=wp.vec3),  # (N,) of the screws at this posture, 0 of a joint that is not learned
    moment_in: wp.array(dtype=wp.vec3),  # (N,)
    moved_by_in: wp.array2d(dtype=int),  # (links, N) whether the joint moves the link
    focal: float,  # [px]
    bend: float,  # of the lens
    corner: float,  # distance of the image's corners from the center [px]
    # Out:
    jacobian_out: wp.array4d(dtype=float),  # (H, W, 2, N) [px/rad], beforehand 0, as it stays off the body
):
    """J of what is in front at each pixel."""
    _, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, front_in.shape[1], column_step):
        point = front_in[y, x]
        if point >= 0:
            p = position_in[point]
            link = link_in[point]
            for n in range(jacobian_out.shape[3]):
                motion = wp.vec2(0.0, 0.0)
                if moved_by_in[link, n] != 0:
                    motion = screw_motion(axis_in[n], moment_in[n], p, focal, bend, corner)
                jacobian_out[y, x, 0, n] = motion[0]
                jacobian_out[y, x, 1, n] = motion[1]


@wp.kernel
def correct_depth(
    row_begin: int,
    column_step: int,
    # In:
    front_in: wp.array2d(dtype=int),  # (H, W) index of a point, negative off the body
    position_in: wp.array(dtype=wp.vec3),  # (P,) in the camera frame
    link_in: wp.array(dtype=int),  # (P,)
    axis_in: wp.array(dtype=wp.vec3),  # (N,) of the screws at this posture, 0 of a joint that is not learned
    moment_in: wp.array(dtype=wp.vec3),  # (N,)
    moved_by_in: wp.array2d(dtype=int),  # (links, N) whether the joint moves the link
    measured_in: wp.array4d(dtype=float),  # (H, W, 2, N) another J [px/rad]
    focal: float,  # [px]
    bend: float,  # of the lens
    corner: float,  # distance of the image's corners from the center [px]
    depth_deviation: float,  # relative standard deviation of the surface's depth
    noise_scale: float,  # noise of the other J, in what no depth explains
    least_noise: float,  # of it, in J
    # Out:
    jacobian_out: wp.array4d(dtype=float),  # (H, W, 2, N) [px/rad], beforehand 0, as it stays off the body
):
    """J of the surface at a depth to which another J speaks: a mean by variances of a pixel's inverse depth.

    J is a part that depth does not change, that of the screws' axes, and one that goes with inverse depth, that of
    their moments: both are linear in it, so one division gives the mean.
    """
    _, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, front_in.shape[1], column_step):
        point = front_in[y, x]
        if point >= 0:
            p = position_in[point]
            link = link_in[point]
            along = float(0.0)
            by_depth = float(0.0)
            apart = float(0.0)
            size = float(0.0)
            for n in range(measured_in.shape[3]):
                J = wp.vec2(0.0, 0.0)
                if moved_by_in[link, n] != 0:
                    J = screw_motion(axis_in[n], moment_in[n], p, focal, bend, corner)
                jacobian_out[y, x, 0, n] = J[0]
                jacobian_out[y, x, 1, n] = J[1]
                off = wp.vec2(measured_in[y, x, 0, n], measured_in[y, x, 1, n]) - J
                apart += wp.length_sq(off)
                size += wp.length_sq(J)
                if moved_by_in[link, n] != 0:
                    part = image_motion(moment_in[n], p, focal, bend, corner)
                    along += wp.dot(off, part)
                    by_depth += wp.length_sq(part)
            change = depth_change(along, by_depth, apart, size, depth_deviation, noise_scale, least_noise)
            if change != 0.0:
                for n in range(measured_in.shape[3]):
                    if moved_by_in[link, n] != 0:
                        part = change * image_motion(moment_in[n], p, focal, bend, corner)
                        jacobian_out[y, x, 0, n] += part[0]
                        jacobian_out[y, x, 1, n] += part[1]
