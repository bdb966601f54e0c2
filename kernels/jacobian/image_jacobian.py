"""The dense image Jacobian's filter: predict DIJE (13), (14) and update DIJE (9) to (12) in one pass.

A pixel's state is its 2 x N Jacobian, followed in the state of second order by the columns of the image
Hessian (see ``covariance.py``). The kernels are specialized on the number of joints and the order, so that
a pixel's matrix stays in registers; :func:`jacobian_kernels` builds them once for each. Each form of the covariance
has a file of its own.
"""

from functools import cache, partial
from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.jacobian.diagonal_single_pass import diagonal_single_pass_kernel
from dense_vs.kernels.jacobian.diagonal_update import diagonal_update_kernel
from dense_vs.kernels.jacobian.full_update import full_update_kernel
from dense_vs.kernels.jacobian.present_jacobian import present_jacobian_kernels
from dense_vs.kernels.jacobian.shared_update import shared_update_kernels
from dense_vs.kernels.jacobian.single_pass_update import single_pass_kernel
from dense_vs.kernels.jacobian.state_image import Layout
from dense_vs.kernels.jacobian.state_types import state_types

wp.set_module_options({"enable_backward": False})


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
    """Kernels for ``joints`` joints and a state of ``order`` 1 or 2, with the types of :func:`state_types`.

    ``update_shared_once(by_model, iterations, or_flow)`` and ``update_diagonal_once(by_model, iterations,
    move_variance)`` give the kernels of one pass. The kernels with a covariance
    per pixel are for order 1. A kernel that is never launched is never compiled.
    """
    types = state_types(joints, order, layout)
    return SimpleNamespace(
        **vars(types),
        **vars(shared_update_kernels(types)),
        **vars(present_jacobian_kernels(types)),
        update_shared_once=partial(single_pass_kernel, joints, order, layout),
        update_diagonal_once=partial(diagonal_single_pass_kernel, joints),
        update_diagonal=diagonal_update_kernel(types),
        update_full=full_update_kernel(types),
    )
