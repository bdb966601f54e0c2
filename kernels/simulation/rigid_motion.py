"""Exact image motion of rigid bodies: image Jacobian, optical flow and robot mask from geom ids, depth and poses.

A pixel in direction n with depth Z shows the point (X, Y, Z) = Z (n, 1) of the geom named by its id. Velocity
V = (Vx, Vy, Vz) of that point in camera axes changes its direction by

    (Vx Z - X Vz) / Z^2,    (Vy Z - Y Vz) / Z^2,

its depth by Vz,
and a displacement D between two frames by the same with Z (Z - Dz) below the line. Focal lengths and the lens
(:mod:`.lens`) make pixels of it. A joint gives V = axis x (p -
anchor) (hinge) or axis (slide) to what it moves. When it moves the camera too, the point appears to stand
still; when it moves only the camera, the point appears to move the other way: hence ``influence``.

Everything is computed from differences of poses, so what does not move has exactly zero flow. Camera
rotations are MuJoCo's (x right, y up, z backward); image quantities use x right, y down, z forward. Pixels without a
surface (id -1) have zero Jacobian and flow.
"""

import warp as wp

from dense_vs.kernels.simulation.lens import lens_displacement, lens_velocity

wp.set_module_options({"enable_backward": False})


@wp.func
def camera_point(direction: wp.vec2, depth: float) -> wp.vec3:
    """Point in a direction (X/Z, Y/Z) in camera axes (x right, y down, z forward)."""
    return wp.vec3(direction[0] * depth, direction[1] * depth, depth)


@wp.func
def flip_y_z(v: wp.vec3) -> wp.vec3:
    """Between MuJoCo's camera axes and those of the image, either way."""
    return wp.vec3(v[0], -v[1], -v[2])


@wp.kernel
def image_jacobian_kernel(
    row_begin: int,
    column_step: int,
    # In:
    ids_in: wp.array3d[int],
    depth_in: wp.array3d[float],
    directions_in: wp.array2d[wp.vec2],  # (height, width) X/Z, Y/Z of every pixel
    focal: wp.vec2,  # fx, fy [px]
    lens: wp.vec2,  # k1, k2
    camera: int,
    camera_position_in: wp.array2d[wp.vec3],  # (worlds, cameras) [m]
    camera_rotation_in: wp.array2d[wp.mat33],
    joint_anchor_in: wp.array2d[wp.vec3],  # (worlds, joints of the model) [m]
    joint_axis_in: wp.array2d[wp.vec3],
    joint_in: wp.array[int],  # (N,) the chosen joints
    slides_in: wp.array[int],  # (N,) 1 for a slide, 0 for a hinge
    influence_in: wp.array2d[float],  # (geoms, N): moves the geom (1 or 0) minus moves the camera (1 or 0)
    # Out:
    # (worlds, height, width, 2 N) px/rad, rows of (2, N) one after the other; 3 N with that of depth [m/rad]
    jacobian_out: wp.array4d[float],
):
    """Image Jacobian of the surface point at every pixel."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = ids_in.shape[2]
    joints = joint_in.shape[0]
    rotation = wp.transpose(camera_rotation_in[world, camera])
    origin = camera_position_in[world, camera]
    for x in range(column, width, column_step):
        geom = ids_in[world, y, x]
        direction = directions_in[y, x]
        p = camera_point(direction, depth_in[world, y, x])
        offset = flip_y_z(p) @ rotation  # rotation holds the inverse: row vector times it rotates to the world
        for n in range(joints):
            u = float(0.0)
            v = float(0.0)
            approach = float(0.0)
            if geom >= 0:
                influence = influence_in[geom, n]
                if influence != 0.0:
                    velocity = joint_axis_in[world, joint_in[n]]
                    if slides_in[n] == 0:
                        velocity = wp.cross(velocity, offset + (origin - joint_anchor_in[world, joint_in[n]]))
                    velocity = flip_y_z(rotation @ velocity) * influence
                    scale = 1.0 / (p[2] * p[2])
                    turning = wp.vec2(
                        (velocity[0] * p[2] - p[0] * velocity[2]) * scale,
                        (velocity[1] * p[2] - p[1] * velocity[2]) * scale,
                    )
                    turning = lens_velocity(lens, direction, turning)
                    u = focal[0] * turning[0]
                    v = focal[1] * turning[1]
                    approach = velocity[2]
            jacobian_out[world, y, x, n] = u
            jacobian_out[world, y, x, joints + n] = v
            if jacobian_out.shape[3] > 2 * joints:
                jacobian_out[world, y, x, 2 * joints + n] = approach


@wp.kernel
def flow_kernel(
    row_begin: int,
    column_step: int,
    # In:
    ids_in: wp.array3d[int],
    depth_in: wp.array3d[float],
    directions_in: wp.array2d[wp.vec2],  # (height, width) X/Z, Y/Z of every pixel
    focal: wp.vec2,  # fx, fy [px]
    lens: wp.vec2,  # k1, k2
    camera: int,
    camera_position_in: wp.array2d[wp.vec3],  # (worlds, cameras) [m]
    camera_rotation_in: wp.array2d[wp.mat33],
    geom_position_in: wp.array2d[wp.vec3],  # (worlds, geoms) [m]
    geom_rotation_in: wp.array2d[wp.mat33],
    previous_camera_position_in: wp.array2d[wp.vec3],
    previous_camera_rotation_in: wp.array2d[wp.mat33],
    previous_geom_position_in: wp.array2d[wp.vec3],
    previous_geom_rotation_in: wp.array2d[wp.mat33],
    # Out:
    flow_out: wp.array3d[wp.vec2],  # px a frame, stored at the pixels of the present frame
):
    """Where the surface point at every pixel is now, minus where it was in the previous frame."""
    world, row, column = wp.tid()
    y = row_begin + row
    width = ids_in.shape[2]
    rotation = camera_rotation_in[world, camera]
    previous_rotation = wp.transpose(previous_camera_rotation_in[world, camera])
    turn = previous_rotation - wp.transpose(rotation)
    origin = camera_position_in[world, camera]
    shift = previous_camera_position_in[world, camera] - origin
    for x in range(column, width, column_step):
        flow = wp.vec2(0.0, 0.0)
        geom = ids_in[world, y, x]
        if geom >= 0:
            direction = directions_in[y, x]
            p = camera_point(direction, depth_in[world, y, x])
            offset = rotation @ flip_y_z(p)  # from the camera to the point, in world axes
            position = geom_position_in[world, geom]
            orientation = geom_rotation_in[world, geom]
            local = wp.transpose(orientation) @ (offset + (origin - position))
            moved = (previous_geom_rotation_in[world, geom] - orientation) @ local
            moved += previous_geom_position_in[world, geom] - position
            # Previous minus present, in camera axes.
            d = flip_y_z(previous_rotation @ (moved - shift) + turn @ offset)
            before = p[2] + d[2]
            if before > 0.0:
                turned = wp.vec2(
                    (p[0] * d[2] - d[0] * p[2]) / (p[2] * before), (p[1] * d[2] - d[1] * p[2]) / (p[2] * before)
                )
                flow = wp.cw_mul(focal, lens_displacement(lens, direction, turned))
        flow_out[world, y, x] = flow


@wp.kernel
def geom_mask_kernel(
    row_begin: int,
    column_step: int,
    # In:
    ids_in: wp.array3d[int],
    member_in: wp.array[wp.uint8],  # (geoms,) 1 for the geoms in the mask
    # Out:
    mask_out: wp.array3d[wp.uint8],
):
    """1 where the geom seen at a pixel is a member, else 0."""
    world, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, ids_in.shape[2], column_step):
        geom = ids_in[world, y, x]
        inside = wp.uint8(0)
        if geom >= 0:
            inside = member_in[geom]
        mask_out[world, y, x] = inside
