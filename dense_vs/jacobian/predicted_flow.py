"""The flow that a joint step would cause by a filter's state: recorded once, as packing takes as long as the kernel."""

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import warp as wp

from dense_vs.kernels.jacobian.covariance import regressors
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.recorded import recorded
from dense_vs.kernels.views import seen_as, write


class PredictedFlow:
    """Answers for either half of a double-buffered state.

    Args:
        kernels: of the filter.
        state: the two halves.
        flow: (B, H, W) of vec2 [px], an array of the answer's kind.
        joints: N.
        threads: CPU threads.
    """

    def __init__(self, kernels: SimpleNamespace, state: Sequence[wp.array], flow: wp.array, joints: int, threads: int):
        device, worlds = flow.device, flow.shape[0]
        self._step = wp.zeros((worlds, joints), dtype=wp.float32, device=device)
        self._displacement = wp.zeros((worlds, joints), dtype=wp.float64, device=device)
        row = wp.zeros((worlds, kernels.columns), dtype=wp.float32, device=device)
        self._flow = wp.zeros_like(flow)
        inputs = [self._step, self._step, self._displacement, row]
        self._regress = recorded(regressors, row.shape, inputs, device)
        self._inputs = inputs  # as long as the recorded pointers
        seen = seen_as(row, kernels.StateRow, row.shape[:1])
        self._multiply = [
            PixelLaunch(kernels.predicted_flow, flow.shape, [half, seen, self._flow], device, threads) for half in state
        ]

    def __call__(self, joint_step: np.ndarray, now: int, displacement: np.ndarray) -> wp.array:
        """J times a joint step, (B, H, W) of vec2 [px], at the present posture; valid until asked again.

        Args:
            joint_step: (B, N) float32 [rad].
            now: which half is the present one.
            displacement: (B, N) float64, of the joints from the state's reference posture [rad].
        """
        write(self._step, joint_step)
        # The kernel takes the posture half a step on, the middle of a frame; here J is that of the present.
        write(self._displacement, displacement - 0.5 * joint_step)
        self._regress.launch()
        self._multiply[now]()
        return self._flow
