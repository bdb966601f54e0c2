"""The element types of a filter's state and its Warp functions, made once for each number of joints and order."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.jacobian.covariance import state_columns
from dense_vs.kernels.jacobian.state_image import Layout, state_image


@cache
def state_types(joints: int, order: int, layout: Layout) -> SimpleNamespace:
    """Types for N = ``joints`` joints and a state of ``order`` 1 or 2.

    ``State`` is (2, C) with C = :func:`state_columns`; ``StateRow`` (C); ``Jacobian`` (2, N); ``JointVector`` (N);
    ``Covariance`` (N, N); ``StateImage``, ``read_state``, ``write_state`` and ``sample_state`` as in
    ``state_image.py``; ``suffix`` tells the Warp modules of different sizes apart, so that a new size never
    recompiles the others.
    """
    columns = state_columns(joints, order)
    State = wp.types.matrix((2, columns), wp.float32)
    return SimpleNamespace(
        joints=joints,
        order=order,
        layout=layout,
        columns=columns,
        State=State,
        StateRow=wp.types.vector(columns, wp.float32),
        Jacobian=wp.types.matrix((2, joints), wp.float32),
        JointVector=wp.types.vector(joints, wp.float32),
        Covariance=wp.types.matrix((joints, joints), wp.float32),
        suffix=f"{layout}_{joints}_{order}",
        **vars(state_image(State, columns, layout)),
    )
