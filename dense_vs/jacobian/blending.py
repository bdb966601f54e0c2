"""A filter's J drawn to one that is known from elsewhere."""

from collections.abc import Callable

import numpy as np
import warp as wp

from dense_vs.kernels.jacobian.present_state import PresentState
from dense_vs.kernels.launch import launch_pixels


def blending(jacobian: np.ndarray, threads: int) -> Callable[[PresentState, np.ndarray], None]:
    """What draws J at the present posture to another ``(H, W, 2, N)`` float32 by shares ``(H, W)`` float32."""

    def blend(present: PresentState, share: np.ndarray) -> None:
        device = present.displacement.device
        other = wp.array(
            np.ascontiguousarray(jacobian)[None], dtype=present.kernels.Jacobian, device=device, copy=False
        )
        weight = wp.array(share[None], dtype=wp.float32, device=device, copy=False)
        arguments = [present.displacement, other, weight, present.state]
        launch_pixels(present.kernels.blend_jacobian, (1, *share.shape), arguments, device, threads)

    return blend
