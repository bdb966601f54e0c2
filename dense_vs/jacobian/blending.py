"""A filter's J drawn to one that is known from elsewhere."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from dense_vs.kernels.jacobian.present_state import PresentState
from dense_vs.kernels.launch import launch_pixels


def blending(jacobian: np.ndarray, threads: int) -> Callable[[PresentState, np.ndarray], None]:
    """What draws J at the present posture to another by shares, both float32 and of B worlds or one.

    Args:
        jacobian: ``(B, H, W, 2, N)`` or ``(H, W, 2, N)`` [px/rad]; shares are ``(B, H, W)`` or ``(H, W)``.
        threads: of a CPU.
    """

    def blend(present: PresentState, share: np.ndarray) -> None:
        device: Any = present.displacement.device
        shape = (present.displacement.shape[0], *share.shape[-2:])
        worlds = np.ascontiguousarray(jacobian).reshape(*shape, *jacobian.shape[-2:])
        other = wp.array(worlds, dtype=present.kernels.Jacobian, device=device, copy=False)
        weight = wp.array(np.ascontiguousarray(share).reshape(shape), dtype=wp.float32, device=device, copy=False)
        arguments = [present.displacement, other, weight, present.state]
        launch_pixels(present.kernels.blend_jacobian, shape, arguments, device, threads)

    return blend
