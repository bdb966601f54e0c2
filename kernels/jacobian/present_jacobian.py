"""J at the present posture, read from the state at every pixel or at points, DIJE (16), and drawn to another J."""

from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear_taps
from dense_vs.kernels.jacobian.covariance import hessian_column

wp.set_module_options({"enable_backward": False})


def present_jacobian_kernels(types: SimpleNamespace) -> SimpleNamespace:
    """Kernels ``read_jacobian``, ``blend_jacobian``, ``sample_points`` and ``coarse_flow`` and the functions
    ``jacobian_at`` and ``jacobian_of`` for a state.
    """
    joints, order = types.joints, types.order
    State, Jacobian, StateImage = types.State, types.Jacobian, types.StateImage
    read_state, write_state, sample_state = types.read_state, types.write_state, types.sample_state
    kernel = wp.kernel(module=f"{__name__}_{types.suffix}", enable_backward=False)

    @wp.func
    def jacobian_of(state: State, displacement: wp.array2d(dtype=wp.float64), world: int) -> Jacobian:
        """J at the present posture: J_i + sum_m H_im d_m."""
        jacobian = Jacobian()
        for i in range(wp.static(joints)):
            x = state[0, i]
            y = state[1, i]
            if wp.static(order == 2):
                for m in range(wp.static(joints)):
                    column = hessian_column(i, m, wp.static(joints))
                    d = wp.float32(displacement[world, m])
                    x += state[0, column] * d
                    y += state[1, column] * d
            jacobian[0, i] = x
            jacobian[1, i] = y
        return jacobian

    @wp.func
    def jacobian_at(
        image: StateImage, displacement: wp.array2d(dtype=wp.float64), world: int, y: int, x: int
    ) -> Jacobian:
        """J at the present posture at a pixel."""
        return jacobian_of(read_state(image, world, y, x), displacement, world)

    @kernel
    def read_jacobian(
        row_begin: int,
        column_step: int,
        # In:
        state_in: StateImage,
        displacement_in: wp.array2d(dtype=wp.float64),
        # Out:
        jacobian_out: wp.array3d(dtype=Jacobian),
    ):
        """J at the present posture at every pixel."""
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, state_in.shape[2], column_step):
            jacobian_out[world, y, x] = jacobian_at(state_in, displacement_in, world, y, x)

    @kernel
    def blend_jacobian(
        row_begin: int,
        column_step: int,
        # In:
        displacement_in: wp.array2d(dtype=wp.float64),
        jacobian_in: wp.array3d(dtype=Jacobian),
        share_in: wp.array3d(dtype=float),
        # In and out:
        state: StateImage,
    ):
        """Draw J at the present posture to another one by a share a pixel; a state's Hessian stays as it is."""
        world, row, column = wp.tid()
        y = row_begin + row
        for x in range(column, state.shape[2], column_step):
            share = share_in[world, y, x]
            if share > 0.0:
                blended = read_state(state, world, y, x)
                step = share * (jacobian_in[world, y, x] - jacobian_of(blended, displacement_in, world))
                for i in range(wp.static(joints)):
                    blended[0, i] += step[0, i]
                    blended[1, i] += step[1, i]
                write_state(state, world, y, x, blended)

    @kernel
    def sample_points(
        # In:
        state_in: StateImage,
        displacement_in: wp.array2d(dtype=wp.float64),
        points_in: wp.array2d(dtype=wp.vec2),
        # Out:
        jacobian_out: wp.array2d(dtype=Jacobian),
    ):
        """J at the present posture at (worlds, K) points, DIJE (16)."""
        world, point = wp.tid()
        p = points_in[world, point]
        taps = bilinear_taps(0, 0, -p, state_in.shape[2], state_in.shape[1])
        state = sample_state(state_in, world, taps)
        jacobian_out[world, point] = jacobian_of(state, displacement_in, world)

    @kernel
    def coarse_flow(
        # In:
        state_in: StateImage,
        regressor_in: wp.array(dtype=types.StateRow),
        most: float,
        # Out:
        flow_out: wp.array3d(dtype=wp.vec2),  # (worlds, height, width) of a smaller image
    ):
        """J dq [px of the image] at the pixels of a smaller one; at most ``most`` long, and 0 where it is no number."""
        world, row, column = wp.tid()
        # The pixel of the image at the smaller one's center.
        y = (2 * row + 1) * state_in.shape[1] // (2 * flow_out.shape[1])
        x = (2 * column + 1) * state_in.shape[2] // (2 * flow_out.shape[2])
        u = read_state(state_in, world, y, x) * regressor_in[world]
        length = wp.length(u)
        if not wp.isfinite(length):
            u = wp.vec2(0.0, 0.0)
        elif length > most:
            u = u * (most / length)
        flow_out[world, row, column] = u

    return SimpleNamespace(
        blend_jacobian=blend_jacobian,
        coarse_flow=coarse_flow,
        jacobian_at=jacobian_at,
        jacobian_of=jacobian_of,
        read_jacobian=read_jacobian,
        sample_points=sample_points,
    )
