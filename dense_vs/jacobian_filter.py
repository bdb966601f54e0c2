"""The filter's arrays on the device and the launches that take it from one frame to the next.

State and covariance are double-buffered: a frame reads one half and writes the other, then they change roles. Every
launch is bound to its arrays once for each of the two roles, so that a frame allocates and packs nothing.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from dense_vs.jacobian_options import JacobianOptions
from dense_vs.kernels.covariance import fixed_gain, regressors, update_shared_covariance
from dense_vs.kernels.flow_field import count_bad_flow
from dense_vs.kernels.image_jacobian import jacobian_kernels
from dense_vs.kernels.launch import PixelLaunch, launch_pixels


class JacobianFilter:
    """State of B worlds with N joints and C columns on one device.

    Args:
        options: checked options.
        device: Warp device.
        threads: CPU threads.

    Attributes:
        shape: (B, H, W).
        state: two of (B, H, W) matrices (2, C), at the reference posture.
        covariance: two of (B, C, C) float64; (B, H, W) of (N) or (N, N) float32 where each pixel has its own.
        displacement: two of (B, N) float64, joint displacement from the reference posture [rad].
        now: which of each two is the present one.
        flow: (B, H, W) of vec2, of the frame that :meth:`advance` takes [px].
        dq: (B, N) float32, its joint step [rad].
        bad: (B, H) int32, pixels of each row whose flow is not finite.
    """

    def __init__(self, options: JacobianOptions, device: wp.Device, threads: int):
        assert options.order is not None  # the options have resolved it
        self.options, self.device, self.threads = options, device, threads
        self.kernels = jacobian_kernels(options.joints, options.order)
        self.shape = (options.worlds, options.height, options.width)
        self._allocate()
        self._record()
        self.reset()

    def reset(self) -> None:
        """J = 0 and H = 0 with their initial variances, at the present posture."""
        options = self.options
        self.now = 0
        self._present_known = False
        self.state[0].zero_()
        self.displacement[0].zero_()
        self.bad.zero_()
        if options.covariance == "diagonal":
            self.covariance[0].fill_(options.initial_variance)
            return
        columns = self.kernels.columns
        of_jacobian = np.arange(columns) < options.joints
        variances = np.where(of_jacobian, options.initial_variance, options.initial_hessian_variance)
        cells = self.shape if options.covariance == "full" else self.shape[:1]
        self.covariance[0].assign(np.broadcast_to(np.diag(variances), (*cells, columns, columns)))

    def stored(self) -> dict[str, wp.array]:
        """What the next frame depends on, by name."""
        now = self.now
        return {
            "state": self.state[now],
            "covariance": self.covariance[now],
            "displacement": self.displacement[now],
        }

    def stage(self, flow: wp.array) -> None:
        """Take in the flow (B, H, W) of vec2 of the next frame and count its bad pixels; no state changes."""
        wp.copy(self.flow, flow)
        self.bad.zero_()
        self._count_bad()

    def advance(self, joint_step: np.ndarray) -> None:
        """Predict and correct by the staged flow and the joint step (B, N) float32 [rad]."""
        self.dq.assign(joint_step)
        self.regress[self.now]()
        self.update_gain[self.now]()
        self.predict[self.now]()
        self.correct[self.now]()
        self.now = 1 - self.now
        self._present_known = False

    def present(self) -> wp.array:
        """J at the present posture, (B, H, W) of (2, N); in order 2 computed when first asked for."""
        if self._present is None:
            return self.state[self.now]
        if not self._present_known:
            self.read[self.now]()
            self._present_known = True
        return self._present

    def predicted_flow(self, joint_step: np.ndarray) -> wp.array:
        """J times a joint step (B, N) float32 [rad], (B, H, W) of vec2 [px]."""
        dq = wp.array(joint_step, dtype=wp.float32, device=self.device)
        # The kernel takes the posture half a step on, the middle of a frame; here J is that of the present.
        middle = self.displacement[self.now].numpy() - 0.5 * joint_step
        displacement = wp.array(middle, dtype=wp.float64, device=self.device)
        row = wp.empty_like(self.regressor)
        wp.launch(regressors, dim=row.shape, inputs=[dq, displacement], outputs=[row], device=self.device)
        out: Any = wp.empty_like(self.flow)
        arguments = [self.state[self.now], _as_vectors(row, self.kernels.StateRow), out]
        launch_pixels(self.kernels.predicted_flow, self.shape, arguments, self.device, self.threads)
        return out

    def at(self, points: np.ndarray) -> wp.array:
        """J at points (B, K, 2) [px], (B, K) of (2, N)."""
        where: Any = wp.array(points.astype(np.float32), dtype=wp.vec2, device=self.device)
        out = wp.empty(where.shape, dtype=self.kernels.Jacobian, device=self.device)
        inputs = [self.state[self.now], self.displacement[self.now], where]
        wp.launch(self.kernels.sample_points, dim=where.shape, inputs=inputs, outputs=[out], device=self.device)
        return out

    def _allocate(self) -> None:
        options, kernels, device = self.options, self.kernels, self.device
        worlds, joints, columns = options.worlds, options.joints, kernels.columns
        per_pixel = {"diagonal": kernels.JointVector, "full": kernels.Covariance}.get(options.covariance)

        def pair(shape: tuple[int, ...], dtype: Any) -> list[Any]:
            return [wp.zeros(shape, dtype=dtype, device=device) for _ in range(2)]

        self.state = pair(self.shape, kernels.State)
        self.covariance = pair(self.shape, per_pixel) if per_pixel else pair((worlds, columns, columns), wp.float64)
        if options.covariance == "fixed":
            self.covariance[1] = self.covariance[0]
        self.displacement = pair((worlds, joints), wp.float64)
        self._present = wp.zeros(self.shape, dtype=kernels.Jacobian, device=device) if options.order == 2 else None
        vec2: Any = wp.vec2
        self.flow: Any = wp.zeros(self.shape, dtype=vec2, device=device)
        self.model_flow: Any = wp.zeros(self.shape, dtype=vec2, device=device)
        self.bad: Any = wp.zeros(self.shape[:2], dtype=wp.int32, device=device)
        self.dq = wp.zeros((worlds, joints), dtype=wp.float32, device=device)
        self.regressor = wp.zeros((worlds, columns), dtype=wp.float32, device=device)
        self.gain = wp.zeros((worlds, columns), dtype=wp.float32, device=device)
        self.projected = wp.zeros((worlds, columns), dtype=wp.float64, device=device)

    def _record(self) -> None:
        options, kernels = self.options, self.kernels
        regressor, gain = (_as_vectors(array, kernels.StateRow) for array in (self.regressor, self.gain))
        dq = _as_vectors(self.dq, kernels.JointVector)
        moved_by = {
            "model": [self.model_flow, options.prediction_iterations],
            "flow": [self.flow, 1],
            "none": [self.flow, 0],
        }[options.prediction]
        flows = [self.flow, self.model_flow]
        noises = [options.process_noise, options.drift_noise, options.measurement_noise, options.max_variance]

        self._count_bad = self._pixels(count_bad_flow, [self.flow, self.bad])
        self.regress, self.update_gain, self.predict, self.correct, self.read = [], [], [], [], []
        for now in range(2):
            state, next_state = self.state[now], self.state[1 - now]
            covariance, next_covariance = self.covariance[now], self.covariance[1 - now]
            displacement, next_displacement = self.displacement[now], self.displacement[1 - now]
            self.regress.append(self._worlds(regressors, [self.dq, displacement, self.regressor], kernels.columns))
            self.predict.append(self._pixels(kernels.predicted_flow, [state, regressor, self.model_flow]))
            if self._present is not None:
                self.read.append(self._pixels(kernels.read_jacobian, [state, displacement, self._present]))
            if options.covariance in ("shared", "fixed"):
                self.correct.append(self._pixels(kernels.update_shared, [state, *moved_by, *flows, gain, next_state]))
            if options.covariance == "shared":
                hessian = [options.hessian_noise, options.initial_hessian_variance]
                inputs = [self.dq, covariance, displacement, *noises, *hessian]
                outputs = [self.projected, next_covariance, next_displacement, self.gain]
                self.update_gain.append(self._worlds(update_shared_covariance, [*inputs, *outputs]))
            elif options.covariance == "fixed":
                weights = [options.initial_variance, options.measurement_noise]
                self.update_gain.append(self._worlds(fixed_gain, [self.dq, *weights, self.gain]))
            else:
                self.update_gain.append(_nothing)  # each pixel has its own gain
                move = [int(options.move_variance)] if options.covariance == "diagonal" else []
                kernel = kernels.update_diagonal if options.covariance == "diagonal" else kernels.update_full
                inputs = [state, covariance, *moved_by, *move, *flows, dq, *noises]
                self.correct.append(self._pixels(kernel, [*inputs, next_state, next_covariance]))

    def _pixels(self, kernel: Any, arguments: list[Any]) -> Callable[[], None]:
        return PixelLaunch(kernel, self.shape, arguments, self.device, self.threads)

    def _worlds(self, kernel: Any, arguments: list[Any], per_world: int | None = None) -> Callable[[], None]:
        dim = self.options.worlds if per_world is None else (self.options.worlds, per_world)
        command: Any = wp.launch(kernel, dim=dim, inputs=arguments, device=self.device, record_cmd=True)
        return command.launch


def _nothing() -> None:
    pass


def _as_vectors(array: wp.array, dtype: Any) -> wp.array:
    """A (B, n) float array seen as (B,) vectors; keeps the memory."""
    view: Any = wp.array(ptr=array.ptr, dtype=dtype, shape=array.shape[:1], device=array.device)
    view._source = array
    return view
