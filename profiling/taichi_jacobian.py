"""The dense Kalman filter in Taichi, written independently of the Warp kernels: (14) once, then (9) to (11).

A 2 x N matrix a pixel in Taichi ndarrays, one fused pass over the image, all cores. Importing this starts Taichi's CPU
runtime, which is global to the process.
"""

# pyright: reportInvalidTypeForm=false
import contextlib
import io
from typing import Any

import numpy as np

with contextlib.redirect_stdout(io.StringIO()):  # Taichi greets on import and on init
    import taichi as ti

    ti.init(arch=ti.cpu, default_fp=ti.f32, offline_cache=True, log_level=ti.ERROR)


def _make_kernel(height: int, width: int, joints: int):
    State = ti.types.matrix(2, joints, ti.f32)
    Vector = ti.types.vector(joints, ti.f32)
    Flow = ti.types.vector(2, ti.f32)

    @ti.kernel
    def step(
        jacobian: ti.types.ndarray(dtype=State, ndim=2),
        variance: ti.types.ndarray(dtype=Vector, ndim=2),
        flow: ti.types.ndarray(dtype=Flow, ndim=2),
        dq: Vector,
        growth: ti.f32,
        max_variance: ti.f32,
        measurement_noise: ti.f32,
        moved_jacobian: ti.types.ndarray(dtype=State, ndim=2),
    ):
        for row, column in ti.ndrange(height, width):
            u = jacobian[row, column] @ dq
            x = ti.min(ti.max(column - u[0], 0.0), width - 1.0)
            y = ti.min(ti.max(row - u[1], 0.0), height - 1.0)
            left = ti.min(ti.cast(x, ti.i32), width - 2)
            top = ti.min(ti.cast(y, ti.i32), height - 2)
            ax = x - left
            ay = y - top
            prior = (jacobian[top, left] * (1 - ax) + jacobian[top, left + 1] * ax) * (1 - ay)
            prior += (jacobian[top + 1, left] * (1 - ax) + jacobian[top + 1, left + 1] * ax) * ay
            p = ti.min(variance[row, column] + growth, max_variance)
            projected = p * dq
            gain = projected / (projected.dot(dq) + measurement_noise)
            error = flow[row, column] - prior @ dq
            moved_jacobian[row, column] = prior + error.outer_product(gain)
            variance[row, column] = p - gain * projected

    return step


class TaichiFilter:
    """The filter in Taichi; the arrays live in Taichi, :meth:`load` copies a flow image to them."""

    def __init__(self, height: int, width: int, joints: int, noises: Any):
        self._noises = noises
        self._state = [ti.Matrix.ndarray(2, joints, ti.f32, (height, width)) for _ in range(2)]
        self._variance = ti.Vector.ndarray(joints, ti.f32, (height, width))
        self._variance.from_numpy(np.full((height, width, joints), noises.initial_variance, dtype=np.float32))
        self._step = _make_kernel(height, width, joints)
        self._vector = ti.types.vector(joints, ti.f32)
        self._shape = height, width

    @property
    def jacobian(self) -> np.ndarray:
        """J, ``(H, W, 2, N)``."""
        return self._state[0].to_numpy()

    @property
    def variance(self) -> np.ndarray:
        """P, ``(H, W, N)``."""
        return self._variance.to_numpy()

    def load(self, flow: np.ndarray) -> Any:
        """A flow image in Taichi's memory, for :meth:`update`."""
        array = ti.Vector.ndarray(2, ti.f32, self._shape)
        array.from_numpy(flow)
        return array

    def update(self, flow: Any, dq: np.ndarray) -> None:
        """One frame, finished on return."""
        noises = self._noises
        growth = noises.process_noise * float(dq @ dq)
        constants = (growth, noises.max_variance, noises.measurement_noise)
        self._step(self._state[0], self._variance, flow, self._vector(*dq.tolist()), *constants, self._state[1])
        ti.sync()
        self._state.reverse()
