"""One frame of the filter where all pixels share one gain: DIJE (10) with the gain of (11), or (12).

Bilinear sampling and the product with dq commute. On a CPU, where arithmetic is what costs, the two numbers of
v = J dq are therefore computed once for the image and sampled in place of the columns of the state wherever only
the product is needed: in the iteration and in the innovation. ``single_pass_update.py`` is the form for a GPU.
"""

from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.pixel_runs import run_module
from dense_vs.kernels.jacobian import row_update

wp.set_module_options({"enable_backward": False})


def shared_update_kernels(types: SimpleNamespace) -> SimpleNamespace:
    """``predicted_flow``, and ``update_shared`` for a CPU, for the state of :func:`.state_types.state_types`."""
    StateImage, StateRow, read_state = types.StateImage, types.StateRow, types.read_state
    in_matrices = types.layout == "matrices"
    flow_row, shared_row = row_update.flow_row(types), row_update.shared_row(types)
    kernel = wp.kernel(module=run_module(f"{__name__}_{types.suffix}"), enable_backward=False)

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
        if wp.static(in_matrices) and column_step == 1:
            flow_row(state_in, regressor, flow_out, world, y)
        else:
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
        world, row, _ = wp.tid()
        measured = measured_in[world]
        shared_row(
            state_in,
            shift_in,
            iterations,
            or_flow != 0,
            rest,
            bound,
            flow_in,
            model_flow_in,
            same_row(measured, regressor_in[world]),
            wp.dot(measured, measured) > 0.0,
            measured,
            gain_in[world],
            state_out,
            world,
            row_begin + row,
        )

    return SimpleNamespace(predicted_flow=predicted_flow, update_shared=update_shared)
