"""The depth row of the image Jacobian: a Kalman filter of depth and its derivatives at every pixel (beyond DIJE).

The same form as that of the pixel rows, DIJE (8) to (11): the state moves with the image by J dq, DIJE (14), and with
uniform noise its covariance holds no image data, so that one small matrix and one gain serve all pixels; it is kept
here, in float64. The state is (Z, D, H), see ``kernels/jacobian/depth_state.py``, and a depth image measures Z. With
s the joint step, transition and observation are

    Z <- Z + D s + 1/2 s^T H s,    D <- D + H s,    z = Z + noise of variance r.
"""

from typing import Any

import numpy as np
import warp as wp

from dense_vs.jacobian.filter import JacobianFilter
from dense_vs.jacobian.options import JacobianOptions
from dense_vs.kernels.jacobian.covariance import hessian_place
from dense_vs.kernels.jacobian.depth_state import depth_columns, depth_state_kernels
from dense_vs.kernels.launch import PixelLaunch, launch_pixels
from dense_vs.kernels.views import seen_as

JUMP = 0.04  # share of a depth by which it changes from one surface to another
# Variances of D and H are those of the pixel rows by the square of this; found on two simulated arms 1 m
# before a camera that shows a meter by 300 px.
PIXELS_PER_METER = 600.0
SLIDE = 0.05  # m/rad: standard deviation that Z gains by a step, as J and flow place the state wrongly on slopes


class DepthFilter:
    """Depth and its row of B worlds on one device.

    Args:
        options: checked options, with ``depth``.
        device: Warp device.
        threads: CPU threads.

    Attributes:
        covariance: (B, S, S) float64 of the S columns of a pixel's state, joints in standard units.
    """

    def __init__(self, options: JacobianOptions, device: wp.Device, threads: int):
        assert options.order is not None  # the options have resolved it
        self._options, self._device, self._threads = options, device, threads
        self._shape = (options.worlds, options.height, options.width)
        self._kernels = depth_state_kernels(options.joints, options.order)
        self._state: list[Any] = [wp.empty(self._shape, dtype=self._kernels.State, device=device) for _ in range(2)]
        self._columns = depth_columns(options.joints, options.order)
        with wp.ScopedDevice(device):
            self._depth: Any = wp.zeros(self._shape, dtype=float)
            self._gain = wp.zeros((options.worlds, self._columns), dtype=float)
            self._dq = wp.zeros((options.worlds, options.joints), dtype=float)
            shift: Any = wp.vec2
            self._shift: Any = None if device.is_cpu else wp.zeros(self._shape, dtype=shift)
        self._update: list[PixelLaunch] = []
        factors = np.array(options.step_factors)
        pairs = self._pairs
        self._factors = factors
        self._column_factors = np.concatenate([[1.0], factors, [factors[i] * factors[j] for i, j in pairs]])
        self.reset()

    def reset(self) -> None:
        """Depth and its row are not known anywhere."""
        for state in self._state:
            state.zero_()
        variance, _ = self._variances
        self.covariance = np.tile(np.diag(variance), (self._options.worlds, 1, 1))

    @property
    def depth(self) -> np.ndarray:
        """Z, float32 (B, H, W) [m], NaN where it is not known."""
        z = self._numbers()[..., 0]
        return np.where(z > 0, z, np.float32(np.nan))

    @property
    def jacobian(self) -> np.ndarray:
        """D, float32 (B, H, W, N) [m/rad]; on a CPU a view."""
        return self._numbers()[..., 1 : 1 + self._options.joints]

    def at(self, points: np.ndarray) -> np.ndarray:
        """D at points (B, K, 2) [px], (B, K, N) [m/rad]."""
        where: Any = wp.array(points.astype(np.float32), dtype=wp.vec2, device=self._device)
        out = wp.empty(where.shape, dtype=self._kernels.State, device=self._device)
        inputs = [self._state[0], where, JUMP]
        wp.launch(self._kernels.sample_depth, dim=where.shape, inputs=inputs, outputs=[out], device=self._device)
        return out.numpy()[..., 1 : 1 + self._options.joints]

    def advance(self, rows: JacobianFilter, joint_step: np.ndarray, depth: np.ndarray | None) -> None:
        """Take a frame, after the pixel rows have.

        Args:
            rows: the filter of the pixel rows, advanced by the same step.
            joint_step: (B, N) float32 [rad].
            depth: (B, H, W) float32 [m], 0 where it is not known; None to predict only.
        """
        self._dq.assign(joint_step)
        self._predict_covariance(joint_step * self._factors)
        if depth is not None:
            self._depth.assign(depth)
            self._gain.assign(self._corrected_gain().astype(np.float32))
        kernels, worlds = self._kernels, self._options.worlds
        dq = seen_as(self._dq, kernels.JointVector, (worlds,))
        gain = seen_as(self._gain, kernels.State, (worlds,))
        iterations = 0 if self._options.prediction == "none" else self._options.prediction_iterations
        arguments = [
            self._state[0], self._moved_by(rows), iterations, dq, self._depth, int(depth is not None), JUMP, gain,
            self._state[1],
        ]  # fmt: skip
        launch_pixels(kernels.update_depth, self._shape, arguments, self._device, self._threads)
        self._state.reverse()

    def stored(self) -> dict[str, np.ndarray]:
        """Arrays that the next frame depends on, by name."""
        return {"depth_state": self._numbers(), "depth_covariance": self.covariance}

    def restore(self, stored: dict[str, np.ndarray]) -> None:
        """Go on from what :meth:`stored` gave."""
        self._state[0].assign(np.ascontiguousarray(stored["depth_state"]))
        self.covariance = np.array(stored["depth_covariance"])

    def _numbers(self) -> np.ndarray:
        return self._state[0].numpy().reshape(*self._shape, self._columns)

    def _moved_by(self, rows: JacobianFilter) -> Any:
        """J dq [px] of the state before the step, which the pixel rows' filter still holds."""
        if rows.model_flow is not None:
            return rows.model_flow
        regressor = seen_as(rows.regressor, rows.kernels.StateRow, rows.regressor.shape[:1])
        if self._shift is None:
            shift: Any = wp.vec2
            self._shift = wp.zeros(self._shape, dtype=shift, device=self._device)
        arguments = [rows.state[1 - rows.now], regressor, self._shift]
        launch_pixels(rows.kernels.predicted_flow, self._shape, arguments, self._device, self._threads)
        return self._shift

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        """(i, j) of the columns of H."""
        joints = self._options.joints
        every = [(i, j) for i in range(joints) for j in range(i, joints)] if self._options.order == 2 else []
        return sorted(every, key=lambda pair: hessian_place(*pair, joints))

    @property
    def _variances(self) -> tuple[np.ndarray, np.ndarray]:
        """At the start and most ones, and growth by a squared joint step, (S,) each."""
        options = self._options
        assert options.process_noise is not None  # the options have resolved it
        counts = [options.joints, len(self._pairs)]
        pixels = np.repeat([options.initial_variance, options.initial_hessian_variance], counts)
        growth = np.repeat([options.process_noise, options.hessian_noise], counts)
        scale = PIXELS_PER_METER**2
        return np.append(options.depth_noise**2, pixels / scale), np.append(SLIDE**2, growth / scale)

    def _predict_covariance(self, steps: np.ndarray) -> None:
        """P <- F P F^T + Q for steps (B, N) in standard units, each variance within its bound."""
        joints = self._options.joints
        most, growth = self._variances
        most[0] = np.inf
        for world, step in enumerate(steps.astype(np.float64)):
            F = np.eye(self._columns)
            F[0, 1 : 1 + joints] = step
            for k, (i, j) in enumerate(self._pairs):
                column = 1 + joints + k
                F[0, column] = step[i] * step[j] * (0.5 if i == j else 1.0)
                F[1 + i, column] = step[j]
                F[1 + j, column] = step[i]
            P = F @ self.covariance[world] @ F.T + np.diag(growth * (step @ step))
            scale = np.sqrt(np.minimum(most / np.maximum(np.diagonal(P), 1e-300), 1.0))
            self.covariance[world] = (P + P.T) / 2 * np.outer(scale, scale)

    def _corrected_gain(self) -> np.ndarray:
        """K (B, S) in the joints' own units; P is corrected."""
        P = self.covariance
        projected = P[:, :, 0]
        innovation = projected[:, :1] + self._options.depth_noise**2
        gain = projected / innovation
        self.covariance = P - gain[:, :, None] * projected[:, None, :]
        return gain * self._column_factors


def depth_bytes(options: JacobianOptions) -> int:
    """Memory of a filter on a device for each world, about [bytes]: both halves of the state, an image, J dq."""
    if not options.depth:
        return 0
    return 4 * options.height * options.width * (2 * depth_columns(options.joints, options.order or 1) + 3)
