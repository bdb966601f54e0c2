"""Where points fixed to geoms are seen, in every world at once."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def project_surface_points(
    # In:
    geom_in: wp.array(dtype=int),  # (worlds,)
    local_in: wp.array(dtype=wp.vec3),  # (worlds,) in the geom's frame [m]
    geom_position_in: wp.array2d(dtype=wp.vec3),  # (worlds, geoms) [m]
    geom_rotation_in: wp.array2d(dtype=wp.mat33),
    camera_position_in: wp.array2d(dtype=wp.vec3),  # (worlds, cameras) [m]
    camera_rotation_in: wp.array2d(dtype=wp.mat33),  # MuJoCo's axes: x right, y up, z backward
    camera: int,
    intrinsics: wp.vec4,  # fx, fy, cx, cy [px]
    # Out:
    pixel_out: wp.array2d(dtype=wp.vec2d),  # (worlds, 1) [px], NaN behind the camera
):
    """Pixel of a point a world."""
    world = wp.tid()
    geom = geom_in[world]
    point = geom_position_in[world, geom] + geom_rotation_in[world, geom] @ local_in[world]
    p = wp.transpose(camera_rotation_in[world, camera]) @ (point - camera_position_in[world, camera])
    pixel = wp.vec2d(wp.float64(wp.nan), wp.float64(wp.nan))
    if p[2] < 0.0:
        pixel[0] = wp.float64(intrinsics[2] - intrinsics[0] * p[0] / p[2])
        pixel[1] = wp.float64(intrinsics[3] + intrinsics[1] * p[1] / p[2])
    pixel_out[world, 0] = pixel
