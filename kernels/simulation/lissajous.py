"""Position on a Lissajous path at a time, one path a world: p(t) = c + a sin(2 pi f t + phi) per axis."""

import warp as wp

wp.set_module_options({"enable_backward": False})


def lissajous_positions(
    centre: wp.array,
    amplitude: wp.array,
    frequency: wp.array,
    phase: wp.array,
    time: wp.array,
    index: int,
    position: wp.array,
) -> None:
    """Write each world's position into column ``index`` of an array.

    Args:
        centre, amplitude, frequency, phase: of the path [m, m, 1/s, rad], each (worlds,) of vec3.
        time: of each world [s], shape (worlds,).
        index: column of ``position`` to write.
        position: written [m], shape (worlds, columns) of vec3.
    """
    wp.launch(
        _lissajous,
        dim=len(time),
        inputs=[centre, amplitude, frequency, phase, time, index],
        outputs=[position],
        device=position.device,
    )


@wp.kernel
def _lissajous(
    # In:
    centre_in: wp.array[wp.vec3],
    amplitude_in: wp.array[wp.vec3],
    frequency_in: wp.array[wp.vec3],
    phase_in: wp.array[wp.vec3],
    time_in: wp.array[float],
    index: int,
    # Out:
    position_out: wp.array2d[wp.vec3],
):
    world = wp.tid()
    p = centre_in[world]
    for axis in range(3):
        turn = wp.static(2.0 * wp.pi) * frequency_in[world][axis] * time_in[world] + phase_in[world][axis]
        p[axis] = p[axis] + amplitude_in[world][axis] * wp.sin(turn)
    position_out[world, index] = p
