"""One frame of the filter where all pixels share one gain: DIJE (10) with the gain of (11), or (12).

Bilinear sampling and the product with dq commute. On a CPU, where arithmetic is what costs, the two numbers of
v = J dq are therefore computed once for the image and sampled in place of the columns of the state wherever only
the product is needed: in the iteration and in the innovation. ``single_pass_update.py`` is the form for a GPU.
"""

from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear_taps
from dense_vs.kernels.image.flow_field import is_flow
from dense_vs.kernels.image.row_taps import find_row_taps
from dense_vs.kernels.jacobian.innovation_bounds import FADE, NEAR, at_rest, bounded_innovation
from dense_vs.kernels.jacobian.moved_pixels import innovation, moved_taps, sample_vec2

wp.set_module_options({"enable_backward": False})


def shared_update_kernels(types: SimpleNamespace) -> SimpleNamespace:
    """``predicted_flow`` and ``update_shared`` for the state of :func:`.state_types.state_types`."""
    StateImage, StateRow = types.StateImage, types.StateRow
    read_state, write_state, sample_state = types.read_state, types.write_state, types.sample_state
    kernel = wp.kernel(module=f"{__name__}_{types.suffix}", enable_backward=False)

    @wp.func
    def same_row(a: StateRow, b: StateRow) -> bool:
        """Whether two rows are the same."""
        same = bool(True)
        for i in range(wp.static(types.columns)):
            if a[i] != b[i]:
                same = False
        return same

    @kernel
    def predicted_flow(
        row_begin: int,
        column_step: int,
        # In:
        state_in: StateImage,
        regressor_in: wp.array(dtype=StateRow),
        # Out:
        flow_out: wp.array3d(dtype=wp.vec2),
    ):
        """DIJE (1), state times regressor at every pixel [px]: J dq, and its second-order term where there is one."""
        world, row, column = wp.tid()
        y = row_begin + row
        regressor = regressor_in[world]
        for x in range(column, state_in.shape[2], column_step):
            flow_out[world, y, x] = read_state(state_in, world, y, x) * regressor

    @kernel
    def update_shared(
        row_begin: int,
        column_step: int,
        # In:
        state_in: StateImage,
        shift_in: wp.array3d(dtype=wp.vec2),  # u of DIJE (13) or J dq of DIJE (14) [px]
        iterations: int,
        places: wp.array3d(dtype=wp.int32),
        fractions: wp.array3d(dtype=wp.float32),
        or_flow: int,
        rest: float,
        bound: float,
        flow_in: wp.array3d(dtype=wp.vec2),
        model_flow_in: wp.array3d(dtype=wp.vec2),
        regressor_in: wp.array(dtype=StateRow),
        measured_in: wp.array(dtype=StateRow),  # the row that predicts the flow
        gain_in: wp.array(dtype=StateRow),
        # Out:
        state_out: StateImage,
    ):
        """State <- moved state + (u - predicted u) K^T, DIJE (10) and (12) with one gain K for the image.

        With ``or_flow`` a pixel's state comes from x - u(x), DIJE (13), where the flow predicted there fits u better
        than at the place of DIJE (14). ``rest`` [px] and ``bound`` as in ``innovation_bounds.py``. A flow that spans
        other frames than the step by which the state moves is compared with the state itself, and moves nothing.
        """
        world, row, column = wp.tid()
        y = row_begin + row
        width = state_in.shape[2]
        gain = gain_in[world]
        measured = measured_in[world]
        one_frame = same_row(measured, regressor_in[world])
        measures = wp.dot(measured, measured) > 0.0
        if column_step == 1:
            find_row_taps(shift_in, world, y, iterations, row_begin, places, fractions)
        for x in range(column, width, column_step):
            taps = moved_taps(shift_in, world, x, y, iterations, row_begin, column_step, places, fractions)
            flow = flow_in[world, y, x]
            error = wp.vec2(0.0, 0.0)
            if one_frame:
                error = innovation(flow, model_flow_in, world, taps)
            if or_flow != 0 and one_frame and is_flow(flow) and wp.dot(error, error) > NEAR:
                by_flow = bilinear_taps(x, y, flow, width, state_in.shape[1])
                error_by_flow = flow - sample_vec2(model_flow_in, world, by_flow)
                if wp.dot(error_by_flow, error_by_flow) < wp.dot(error, error):
                    taps = by_flow
                    error = error_by_flow
            prior = sample_state(state_in, world, taps)
            if not one_frame and is_flow(flow):
                error = flow - prior * measured
            if measures and is_flow(flow) and at_rest(flow, error, rest):
                write_state(state_out, world, y, x, FADE * prior)
            else:
                write_state(state_out, world, y, x, prior + wp.outer(bounded_innovation(error, flow, bound), gain))

    return SimpleNamespace(predicted_flow=predicted_flow, update_shared=update_shared)
