"""Rotations of a serial arm's hand for many trial axes at once: residuals and their Jacobian.

The rotation part of the pose error (4) of Gothoskar et al., alone: axes w_i and a home rotation H turn the hand by
R(q) = exp(w_1 q_1) ... exp(w_n q_n) H. Half the squared Frobenius distance to a measured rotation M has the gradient
-2 D^T e and the Gauss-Newton matrix 2 D^T D, where e is the axial vector of the antisymmetric part of M R^T and D holds
the world-frame turns of R: (A_{i-1} - A_i) for a turn of w_i and A_n for one of H. So three numbers a sample stand for
the nine of the matrix.
"""

from typing import Any

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def rotation_chain_kernel(
    # In:
    joints_in: wp.array2d[wp.float64],  # (T, n) [rad] from the home pose
    measured_in: wp.array[wp.mat33d],  # (T,)
    weights_in: wp.array[wp.float64],  # (T,) roots
    axes_in: wp.array2d[wp.vec3d],  # (runs, n)
    tangents_in: wp.array3d[wp.vec3d],  # (runs, n, 2)
    home_in: wp.array[wp.mat33d],  # (runs,)
    # Out:
    errors_out: wp.array2d[wp.vec3d],  # (runs, T)
    costs_out: wp.array2d[wp.float64],  # (runs, T) half the weighted squared Frobenius distance
    turns_out: wp.array4d[wp.float64],  # (runs, T, 3, 2 n + 3)
):
    """Error and its derivative for one sample of one trial."""
    run, sample = wp.tid()
    joints = joints_in.shape[1]
    weight = weights_in[sample]
    rotation = wp.identity(n=3, dtype=wp.float64)
    for i in range(joints):
        axis = axes_in[run, i]
        angle = joints_in[sample, i]
        s = wp.sin(angle)
        c = wp.cos(angle)
        step = c * wp.identity(n=3, dtype=wp.float64) + s * wp.skew(axis)
        step = step + (wp.float64(1.0) - c) * wp.outer(axis, axis)
        after = rotation @ step
        difference = weight * (rotation - after)
        for k in range(2):
            column = difference @ tangents_in[run, i, k]
            for row in range(3):
                turns_out[run, sample, row, 2 * i + k] = column[row]
        rotation = after
    for row in range(3):
        for k in range(3):
            turns_out[run, sample, row, 2 * joints + k] = weight * rotation[row, k]
    m = measured_in[sample] @ wp.transpose(rotation @ home_in[run])
    half = wp.float64(0.5) * weight
    errors_out[run, sample] = half * wp.vec3d(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    costs_out[run, sample] = weight * weight * (wp.float64(3.0) - wp.trace(m))


class RotationChain:
    """The kernel bound to measurements ``(T, 3, 3)``, joints ``(T, n)`` and weights ``(T,)``, for ``runs`` trials."""

    def __init__(self, runs: int, joints: np.ndarray, measured: np.ndarray, weights: np.ndarray, device: Any = "cpu"):
        samples, count = joints.shape
        self.device = wp.get_device(device)

        def given(values: np.ndarray, dtype: Any) -> Any:
            return wp.array(np.ascontiguousarray(values, dtype=np.float64), dtype=dtype, device=self.device)

        def zeros(shape: tuple[int, ...], dtype: Any = wp.float64) -> Any:
            return wp.zeros(shape, dtype=dtype, device=self.device)

        self._given = [given(joints, wp.float64), given(measured, wp.mat33d), given(np.sqrt(weights), wp.float64)]
        self._trial = [zeros((runs, count), wp.vec3d), zeros((runs, count, 2), wp.vec3d), zeros((runs,), wp.mat33d)]
        self._out = [zeros((runs, samples), wp.vec3d), zeros((runs, samples)), zeros((runs, samples, 3, 2 * count + 3))]

    def evaluate(self, axes: np.ndarray, tangents: np.ndarray, home: np.ndarray) -> tuple[np.ndarray, ...]:
        """Costs ``(k,)``, errors ``(k, T, 3)`` and turns ``(k, T, 3, 2 n + 3)`` of k <= runs trials.

        Args:
            axes: ``(k, n, 3)`` unit vectors.
            tangents: ``(k, n, 2, 3)`` orthonormal to them.
            home: ``(k, 3, 3)``.
        """
        trials = len(axes)
        for target, value in zip(self._trial, (axes, tangents, home), strict=True):
            if self.device.is_cpu:
                target.numpy()[:trials] = value
            else:
                full = target.numpy()
                full[:trials] = value
                target.assign(full)
        wp.launch(
            rotation_chain_kernel,
            dim=(trials, self._out[1].shape[1]),
            inputs=[*self._given, *self._trial, *self._out],
            device=self.device,
            record_tape=False,
        )
        errors, costs, turns = (array.numpy()[:trials] for array in self._out)
        return costs.sum(axis=1), errors, turns
