"""The dense image Jacobian's filter: predict (13), (14) and update (9) to (12) of DIJE in one pass.

A pixel's state is its 2 x N Jacobian, followed in the state of second order by the columns of the image
Hessian (see ``covariance.py``). The kernels are specialised on the number of joints and the order, so that
a pixel's matrix stays in registers; :func:`jacobian_kernels` builds them once for each.

Prediction moves the state image along a displacement image v: y = x - v(x), repeated as y = x - v(y).
Bilinear sampling and the product with dq commute, so on a CPU, where arithmetic is what costs, the two numbers
of v = J dq are computed once for the image and sampled in place of the columns of the state wherever only the product
is needed: in the iteration and in the innovation. On a GPU, where moving the state costs more than sampling
it twice, :func:`update_shared_once` does the same without the image of v.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.bilinear import Taps, bilinear, bilinear_taps
from dense_vs.kernels.image.flow_field import finite
from dense_vs.kernels.image.row_taps import find_row_taps, row_taps
from dense_vs.kernels.image.tiles import tile_pixel
from dense_vs.kernels.jacobian.covariance import hessian_column, state_columns
from dense_vs.kernels.jacobian.state_image import Layout, state_image

wp.set_module_options({"enable_backward": False})

sample_vec2 = bilinear(wp.vec2)


@wp.func
def displacement(
    image: wp.array3d(dtype=wp.vec2), world: int, x: int, y: int, iterations: int, width: int, height: int
) -> wp.vec2:
    """Displacement [px] of the point now at (x, y): v(x), then v(x - v(x)), ... ``iterations`` times, 0 to 3."""
    moved = wp.vec2(0.0, 0.0)
    if iterations > 0:
        moved = image[world, y, x]
        if not finite(moved):
            return wp.vec2(0.0, 0.0)
    if iterations > 1:
        moved = sample_vec2(image, world, bilinear_taps(x, y, moved, width, height))
    if iterations > 2:
        moved = sample_vec2(image, world, bilinear_taps(x, y, moved, width, height))
    return moved


@wp.func
def moved_taps(
    image: wp.array3d(dtype=wp.vec2),
    world: int,
    x: int,
    y: int,
    iterations: int,
    band: int,
    column_step: int,
    places: wp.array3d(dtype=wp.int32),
    fractions: wp.array3d(dtype=wp.float32),
) -> Taps:
    """Taps for where the point now at (x, y) was: found for the row where a thread walks one, else here."""
    if column_step == 1:
        return row_taps(band, x, places, fractions)
    width = image.shape[2]
    height = image.shape[1]
    return bilinear_taps(x, y, displacement(image, world, x, y, iterations, width, height), width, height)


@wp.kernel
def forget_state(
    # In:
    where_in: wp.array(dtype=int),  # (worlds,)
    # Out:
    floats_out: wp.array3d(dtype=float),  # (worlds n, H, m): the states as numbers, n images of rows a world
):
    """Zero where ``where_in`` is not 0; a thread a row, as it is rare and most worlds only look."""
    image, row = wp.tid()
    if where_in[(image * where_in.shape[0]) // floats_out.shape[0]] == 0:
        return
    for k in range(floats_out.shape[2]):
        floats_out[image, row, k] = 0.0


@cache
def jacobian_kernels(joints: int, order: int = 1, layout: Layout = "matrices") -> SimpleNamespace:
    """Kernels for ``joints`` joints and a state of ``order`` 1 or 2, with their element types.

    ``State`` is (2, C) with C = :func:`state_columns`; ``StateRow`` (C); ``Jacobian`` (2, N); ``JointVector``
    (N); ``Covariance`` (N, N); ``StateImage`` an image of states, see ``state_image.py``. The kernels with a covariance
    per pixel exist for order 1.
    """
    columns = state_columns(joints, order)
    State = wp.types.matrix((2, columns), wp.float32)
    StateRow = wp.types.vector(columns, wp.float32)
    Jacobian = wp.types.matrix((2, joints), wp.float32)
    JointVector = wp.types.vector(joints, wp.float32)
    Covariance = wp.types.matrix((joints, joints), wp.float32)
    stored = state_image(State, columns, layout)
    StateImage = stored.StateImage
    read_state, write_state, sample_state = stored.read_state, stored.write_state, stored.sample_state
    sample_variance = bilinear(JointVector)

    def kernel_in(form: str):
        # A module a form and size: a new size never recompiles the others, an unused form is never compiled.
        return wp.kernel(module=f"{__name__}_{form}_{layout}_{joints}_{order}", enable_backward=False)

    @wp.func
    def innovation(flow: wp.vec2, model_flow: wp.array3d(dtype=wp.vec2), world: int, taps: Taps) -> wp.vec2:
        """u - predicted u [px]; zero where the flow is not finite, which leaves the prediction as it is."""
        if finite(flow):
            return flow - sample_vec2(model_flow, world, taps)
        return wp.vec2(0.0, 0.0)

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

    @kernel_in("shared")
    def predicted_flow(
        row_begin: int,
        column_step: int,
        # In:
        state_in: StateImage,
        regressor_in: wp.array(dtype=StateRow),
        # Out:
        flow_out: wp.array3d(dtype=wp.vec2),
    ):
        """State times regressor at every pixel [px]: J dq, and its second-order term where there is one."""
        world, row, column = wp.tid()
        y = row_begin + row
        regressor = regressor_in[world]
        for x in range(column, state_in.shape[2], column_step):
            flow_out[world, y, x] = read_state(state_in, world, y, x) * regressor

    @kernel_in("shared")
    def update_shared(
        row_begin: int,
        column_step: int,
        # In:
        state_in: StateImage,
        displacement_in: wp.array3d(dtype=wp.vec2),
        iterations: int,
        places: wp.array3d(dtype=wp.int32),
        fractions: wp.array3d(dtype=wp.float32),
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
        gain_in: wp.array(dtype=StateRow),
        # Out:
        state_out: StateImage,
    ):
        """State <- moved state + (u - predicted u) K^T, (10) and (12) with one gain K for the image."""
        world, row, column = wp.tid()
        y = row_begin + row
        width = state_in.shape[2]
        gain = gain_in[world]
        if column_step == 1:
            find_row_taps(displacement_in, world, y, iterations, row_begin, places, fractions)
        for x in range(column, width, column_step):
            taps = moved_taps(displacement_in, world, x, y, iterations, row_begin, column_step, places, fractions)
            prior = sample_state(state_in, world, taps)
            error = innovation(flow_in[world, y, x], model_flow_in, world, taps)
            write_state(state_out, world, y, x, prior + wp.outer(error, gain))

    @cache
    def update_shared_once(by_model: bool, iterations: int) -> wp.Kernel:
        """Tile kernel of one pass: ``predicted_flow`` and ``update_shared``, v = J dq computed wherever it is wanted.

        The displacement is v, iterated, with ``by_model``, else the flow, or none with 0 iterations. The choice
        is compiled in: a GPU is held up by the number of instructions here.
        """
        module = f"{__name__}_once_{int(by_model)}{iterations}_{joints}_{order}"

        @wp.kernel(module=module, enable_backward=False, grid_stride=False)
        def update_once(
            # In:
            state_in: StateImage,
            regressor_in: wp.array(dtype=StateRow),
            flow_in: wp.array3d(dtype=wp.vec2),
            gain_in: wp.array(dtype=StateRow),
            # Out:
            state_out: StateImage,
        ):
            """State <- moved state + (u - predicted u) K^T."""
            height = state_in.shape[1]
            width = state_in.shape[2]
            place = tile_pixel(wp.int64(wp.tid()), height, width)
            world = place[0]
            y = place[1]
            x = place[2]
            if x >= width or y >= height:
                return
            regressor = regressor_in[world]
            flow = flow_in[world, y, x]
            moved = wp.vec2(0.0, 0.0)
            if wp.static(by_model):
                moved = read_state(state_in, world, y, x) * regressor
                if finite(moved):
                    for _ in range(wp.static(iterations - 1)):
                        moved = sample_state(state_in, world, bilinear_taps(x, y, moved, width, height)) * regressor
                else:
                    moved = wp.vec2(0.0, 0.0)
            elif wp.static(iterations > 0) and finite(flow):
                moved = flow
            prior = sample_state(state_in, world, bilinear_taps(x, y, moved, width, height))
            error = wp.vec2(0.0, 0.0)
            if finite(flow):
                error = flow - prior * regressor
            write_state(state_out, world, y, x, prior + wp.outer(error, gain_in[world]))

        return update_once

    @kernel_in("diagonal")
    def update_diagonal(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: StateImage,
        variance_in: wp.array3d(dtype=JointVector),
        displacement_in: wp.array3d(dtype=wp.vec2),
        iterations: int,
        places: wp.array3d(dtype=wp.int32),
        fractions: wp.array3d(dtype=wp.float32),
        move_variance: int,
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
        dq_in: wp.array(dtype=JointVector),
        process_noise: float,
        drift_noise: float,
        measurement_noise: float,
        max_variance: float,
        # Out:
        jacobian_out: StateImage,
        variance_out: wp.array3d(dtype=JointVector),
    ):
        """(9) to (11): a variance per pixel and joint, covariances dropped."""
        world, row, column = wp.tid()
        y = row_begin + row
        width = jacobian_in.shape[2]
        dq = dq_in[world]
        growth = process_noise * wp.dot(dq, dq) + drift_noise
        if column_step == 1:
            find_row_taps(displacement_in, world, y, iterations, row_begin, places, fractions)
        for x in range(column, width, column_step):
            taps = moved_taps(displacement_in, world, x, y, iterations, row_begin, column_step, places, fractions)
            prior = sample_state(jacobian_in, world, taps)
            variance = variance_in[world, y, x]
            if move_variance != 0:
                variance = sample_variance(variance_in, world, taps)
            for i in range(wp.static(joints)):
                variance[i] = wp.min(variance[i] + growth, max_variance)
            flow = flow_in[world, y, x]
            projected = wp.cw_mul(variance, dq)
            gain = projected * (1.0 / (wp.dot(projected, dq) + measurement_noise))
            error = innovation(flow, model_flow_in, world, taps)
            write_state(jacobian_out, world, y, x, prior + wp.outer(error, gain))
            if finite(flow):
                variance = variance - wp.cw_mul(gain, projected)
            variance_out[world, y, x] = variance

    @kernel_in("full")
    def update_full(
        row_begin: int,
        column_step: int,
        # In:
        jacobian_in: StateImage,
        covariance_in: wp.array3d(dtype=Covariance),
        displacement_in: wp.array3d(dtype=wp.vec2),
        iterations: int,
        places: wp.array3d(dtype=wp.int32),
        fractions: wp.array3d(dtype=wp.float32),
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
        dq_in: wp.array(dtype=JointVector),
        process_noise: float,
        drift_noise: float,
        measurement_noise: float,
        max_variance: float,
        # Out:
        jacobian_out: StateImage,
        covariance_out: wp.array3d(dtype=Covariance),
    ):
        """Qian and Su's filter: a full N x N covariance per pixel."""
        world, row, column = wp.tid()
        y = row_begin + row
        width = jacobian_in.shape[2]
        dq = dq_in[world]
        growth = process_noise * wp.dot(dq, dq) + drift_noise
        if column_step == 1:
            find_row_taps(displacement_in, world, y, iterations, row_begin, places, fractions)
        for x in range(column, width, column_step):
            taps = moved_taps(displacement_in, world, x, y, iterations, row_begin, column_step, places, fractions)
            prior = sample_state(jacobian_in, world, taps)
            covariance = covariance_in[world, y, x]
            scale = JointVector()
            for i in range(wp.static(joints)):
                covariance[i, i] = covariance[i, i] + growth
                scale[i] = wp.min(1.0, wp.sqrt(max_variance / covariance[i, i]))
            covariance = wp.cw_mul(covariance, wp.outer(scale, scale))
            flow = flow_in[world, y, x]
            projected = covariance * dq
            gain = projected * (1.0 / (wp.dot(projected, dq) + measurement_noise))
            error = innovation(flow, model_flow_in, world, taps)
            write_state(jacobian_out, world, y, x, prior + wp.outer(error, gain))
            if finite(flow):
                covariance = covariance - wp.outer(gain, projected)
            covariance_out[world, y, x] = covariance

    @kernel_in("shared")
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

    @kernel_in("shared")
    def sample_points(
        # In:
        state_in: StateImage,
        displacement_in: wp.array2d(dtype=wp.float64),
        points_in: wp.array2d(dtype=wp.vec2),
        # Out:
        jacobian_out: wp.array2d(dtype=Jacobian),
    ):
        """J at the present posture at (worlds, K) points, (16)."""
        world, point = wp.tid()
        p = points_in[world, point]
        taps = bilinear_taps(0, 0, -p, state_in.shape[2], state_in.shape[1])
        state = sample_state(state_in, world, taps)
        jacobian_out[world, point] = jacobian_of(state, displacement_in, world)

    return SimpleNamespace(
        order=order,
        columns=columns,
        State=State,
        StateRow=StateRow,
        Jacobian=Jacobian,
        JointVector=JointVector,
        Covariance=Covariance,
        StateImage=StateImage,
        jacobian_at=jacobian_at,
        predicted_flow=predicted_flow,
        update_shared=update_shared,
        update_shared_once=update_shared_once,
        update_diagonal=update_diagonal,
        update_full=update_full,
        read_jacobian=read_jacobian,
        sample_points=sample_points,
    )
