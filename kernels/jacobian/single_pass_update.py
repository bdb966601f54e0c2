"""One frame of the filter in a single pass over the image, for a GPU: DIJE (13) or (14), then (10).

On a GPU, where moving the state costs more than sampling it twice, v = J dq is computed wherever it is wanted
instead of being kept as an image.
"""

from functools import cache

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear_taps
from dense_vs.kernels.image.flow_field import finite, is_flow
from dense_vs.kernels.image.tiles import tile_pixel
from dense_vs.kernels.jacobian.innovation_bounds import FADE, NEAR, at_rest, bounded_innovation
from dense_vs.kernels.jacobian.state_image import Layout
from dense_vs.kernels.jacobian.state_types import state_types

wp.set_module_options({"enable_backward": False})


@cache
def single_pass_kernel(
    joints: int, order: int, layout: Layout, by_model: bool, iterations: int, or_flow: bool = False, spans: bool = False
) -> wp.Kernel:
    """Tile kernel that does what ``predicted_flow`` and ``update_shared`` do.

    Pixels are moved by v = J dq, iterated, with ``by_model``, else by the flow, or not at all with 0 iterations; with
    ``or_flow`` as in ``update_shared``; with ``spans`` a flow may span other frames than the step. The choice is
    compiled in: a GPU is held up by the number of instructions here.
    """
    types = state_types(joints, order, layout)
    StateImage, StateRow = types.StateImage, types.StateRow
    read_state, write_state, sample_state = types.read_state, types.write_state, types.sample_state
    module = f"{__name__}_{int(by_model)}{iterations}{int(or_flow)}{int(spans)}_{types.suffix}"

    @wp.kernel(module=module, enable_backward=False, grid_stride=False)
    def update_once(
        # In:
        state_in: StateImage,
        regressor_in: wp.array(dtype=StateRow),
        flow_in: wp.array3d(dtype=wp.vec2),
        measured_in: wp.array(dtype=StateRow),  # the row that predicts the flow
        rest: float,
        bound: float,
        gain_in: wp.array(dtype=StateRow),
        # Out:
        state_out: StateImage,
    ):
        """State <- moved state + (u - predicted u) K^T, DIJE (10) and (12)."""
        height = state_in.shape[1]
        width = state_in.shape[2]
        place = tile_pixel(wp.int64(wp.tid()), height, width)
        world = place[0]
        y = place[1]
        x = place[2]
        if x >= width or y >= height:
            return
        regressor = regressor_in[world]
        one_frame = bool(True)
        if wp.static(spans):
            for i in range(wp.static(types.columns)):
                if measured_in[world][i] != regressor[i]:
                    one_frame = False
        flow = flow_in[world, y, x]
        moved = wp.vec2(0.0, 0.0)
        if wp.static(by_model):  # DIJE (14)
            moved = read_state(state_in, world, y, x) * regressor
            if finite(moved):
                for _ in range(wp.static(iterations - 1)):
                    moved = sample_state(state_in, world, bilinear_taps(x, y, moved, width, height)) * regressor
            else:
                moved = wp.vec2(0.0, 0.0)
        elif wp.static(iterations > 0) and is_flow(flow):  # DIJE (13)
            moved = flow
        prior = sample_state(state_in, world, bilinear_taps(x, y, moved, width, height))
        error = wp.vec2(0.0, 0.0)
        if is_flow(flow):
            error = flow - prior * measured_in[world]
            if wp.static(or_flow) and one_frame and wp.dot(error, error) > NEAR:
                prior_by_flow = sample_state(state_in, world, bilinear_taps(x, y, flow, width, height))
                error_by_flow = flow - prior_by_flow * regressor
                if wp.dot(error_by_flow, error_by_flow) < wp.dot(error, error):
                    prior = prior_by_flow
                    error = error_by_flow
            if wp.dot(measured_in[world], measured_in[world]) > 0.0 and at_rest(flow, error, rest):
                write_state(state_out, world, y, x, FADE * prior)
                return
            error = bounded_innovation(error, flow, bound)
        write_state(state_out, world, y, x, prior + wp.outer(error, gain_in[world]))

    return update_once
