"""Joint position targets of many worlds: moved once a frame, fed to the actuators along a ramp.

A step of the target at the start of a frame would shake the arm; real controllers interpolate. At a fraction
s in (0, 1] of the frame the control of joint n is

    ctrl = g_n (previous_n + s (target_n - previous_n)),

g_n being the control that holds joint n at position 1.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def move_targets_kernel(
    # In:
    step_in: wp.array2d[float],  # (worlds, N) rad or m
    limits_in: wp.array[wp.vec2],  # (N,) lowest and highest target
    # Out:
    previous_out: wp.array2d[float],  # (worlds, N)
    target_out: wp.array2d[float],
):
    """previous = target; target = target + step within the limits."""
    world, n = wp.tid()
    previous = target_out[world, n]
    previous_out[world, n] = previous
    target_out[world, n] = wp.clamp(previous + step_in[world, n], limits_in[n][0], limits_in[n][1])


@wp.kernel
def ramp_control_kernel(
    # In:
    previous_in: wp.array2d[float],
    target_in: wp.array2d[float],
    fraction: float,
    ctrl_per_position_in: wp.array[float],  # (N,)
    actuator_in: wp.array[int],  # (N,)
    # Out:
    ctrl_out: wp.array2d[float],  # (worlds, actuators)
):
    """Controls of the chosen joints at a fraction of the frame."""
    world, n = wp.tid()
    previous = previous_in[world, n]
    position = previous + fraction * (target_in[world, n] - previous)
    ctrl_out[world, actuator_in[n]] = ctrl_per_position_in[n] * position
