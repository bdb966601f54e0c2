"""Which pixels around a point move as the point does: its surface, by the image Jacobian (beyond the paper).

A pixel belongs to the point's surface where |J(x) - J(p)| <= share |J(p)|. Where J(p) is 0, and outside the window
that is looked at, all pixels count.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.jacobian.image_jacobian import jacobian_kernels
from dense_vs.kernels.jacobian.state_image import Layout

wp.set_module_options({"enable_backward": False})


@cache
def surface_weight_kernels(joints: int, order: int, layout: Layout) -> SimpleNamespace:
    """The kernel for an image of states as :func:`jacobian_kernels` takes it."""
    kernels = jacobian_kernels(joints, order, layout)
    StateImage, Jacobian, jacobian_at = kernels.StateImage, kernels.Jacobian, kernels.jacobian_at

    @wp.kernel(module=f"{__name__}_{layout}_{joints}_{order}", enable_backward=False)
    def surface_weights(
        # In:
        where_in: wp.array(dtype=int),  # (worlds,)
        state_in: StateImage,
        displacement_in: wp.array2d(dtype=wp.float64),
        points_in: wp.array2d(dtype=wp.vec2d),  # (worlds, 1) [px]
        jacobian_in: wp.array2d(dtype=Jacobian),  # (worlds, 1), J at the points
        reach: int,  # px from the point to the window's border
        share: float,
        # Out:
        weights_out: wp.array3d(dtype=float),  # (worlds, H, W)
    ):
        """1 on the point's surface, 0 beside it, within the window of the chosen worlds."""
        world, row, column = wp.tid()
        if where_in[world] == 0:
            return
        p = points_in[world, 0]
        if not (wp.isfinite(p[0]) and wp.isfinite(p[1])):
            return
        x = int(wp.floor(p[0])) + column - reach
        y = int(wp.floor(p[1])) + row - reach
        if x < 0 or y < 0 or x >= weights_out.shape[2] or y >= weights_out.shape[1]:
            return
        own = jacobian_in[world, 0]
        size = wp.ddot(own, own)
        other = jacobian_at(state_in, displacement_in, world, y, x) - own
        weight = float(1.0)
        if size > 0.0 and wp.ddot(other, other) > share * share * size:
            weight = 0.0
        weights_out[world, y, x] = weight

    return SimpleNamespace(surface_weights=surface_weights)
