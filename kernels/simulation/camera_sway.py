"""A camera that sways: turned about its own axes by sums of sinusoids, one set of phases a world."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def sway_kernel(
    # In:
    amplitude: float,  # rad, of each sinusoid
    frequency_in: wp.array[wp.vec3],  # (sinusoids,) 1/s, about each axis
    phase_in: wp.array2d[wp.vec3],  # (worlds, sinusoids) rad
    time_in: wp.array[float],  # (worlds,) s
    camera: int,
    # In and out:
    rotation: wp.array2d[wp.mat33],  # (worlds, cameras), the columns are the camera's axes in the world
):
    """Turn the camera's axes by the rotation vector that its sinusoids add up to now."""
    world = wp.tid()
    turn = wp.vec3()
    for wave in range(frequency_in.shape[0]):
        for axis in range(3):
            angle = 2.0 * wp.pi * frequency_in[wave][axis] * time_in[world] + phase_in[world, wave][axis]
            turn[axis] = turn[axis] + amplitude * wp.sin(angle)
    angle = wp.length(turn)
    if angle > 0.0:
        swayed = wp.quat_to_matrix(wp.quat_from_axis_angle(turn / angle, angle))
        rotation[world, camera] = rotation[world, camera] @ swayed
