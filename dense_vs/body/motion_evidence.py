"""Evidence that what is seen at a pixel moves with the joints, gathered frame by frame (beyond the paper).

The filter and its running energies are those of :mod:`dense_vs.kernels.body.motion_evidence`. The filter is of first
order with one covariance for the image, and ten times the measurement noise of the estimator's: at the estimator's
own, the share of a walker that is taken for the body is about five times as large.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import warp as wp

from dense_vs.checks import check_number
from dense_vs.kernels.body.motion_evidence import self_motion_kernels
from dense_vs.kernels.jacobian.covariance import update_shared_covariance
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.views import seen_as

_ANY_SHARE = 1e30  # of unexplained motion


@dataclass(frozen=True, kw_only=True)
class SelfMotionOptions:
    """Constants of the filter and of the evidence; px and rad (m for a prismatic joint).

    Attributes:
        decay: of the energies per frame in which something moves.
        rest: where neither flow nor prediction reaches it a frame is no evidence [px].
        still: flow of an image that stands still [px].
        due: predicted motion that a still image contradicts [px].
        unexplained: share of the motion's energy that the joints may leave unexplained on the body.
        least_energy: of flow and of what is unexplained; with less of both nothing is known [px^2].
        process_noise, measurement_noise, initial_variance, max_joint_step: as in
            :class:`dense_vs.jacobian.options.JacobianOptions`.
    """

    decay: float = 0.93
    rest: float = 0.1
    still: float = 0.2
    due: float = 0.5
    unexplained: float = 0.125
    least_energy: float = 0.1
    process_noise: float = 1e4
    measurement_noise: float = 0.1
    initial_variance: float = 1e4
    max_joint_step: float = 100.0

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("measurement_noise", "initial_variance", "max_joint_step"):
                check_number(field.name, value, above=0)
            else:
                check_number(field.name, value, least=0, most=1 if field.name in ("decay", "unexplained") else None)


class SelfMotion:
    """The filter's state on one device.

    Args:
        shape: (B, H, W).
        joints: N.
        device: Warp device.
        threads: CPU threads; any number gives the same bits.
        options: constants.
        factors: (N,), what brings each joint's step to standard units, 0 where it is left out; ones for rad.

    Attributes:
        frames: that have been observed.
        labels: (B, H, W) int8, what :meth:`label` wrote last.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        joints: int,
        device: wp.Device,
        threads: int,
        options: SelfMotionOptions,
        factors: np.ndarray | None = None,
    ):
        self.shape, self.joints, self.device, self.threads, self.options = shape, joints, device, threads, options
        self._kernels = kernels = self_motion_kernels(joints)
        worlds = shape[0]

        def zeros(shape: tuple[int, ...], dtype: Any) -> Any:
            return wp.zeros(shape, dtype=dtype, device=device)

        self.labels, self._flags = zeros(shape, wp.int8), zeros(shape, wp.int8)
        self.flow = zeros(shape, wp.vec2)
        self._motion = zeros(shape, wp.vec2)
        self._jacobian = [zeros(shape, kernels.Jacobian) for _ in range(2)]
        self._energy = [zeros(shape, wp.vec2) for _ in range(2)]
        self._covariance = [zeros((worlds, joints, joints), wp.float64) for _ in range(2)]
        self._displacement = [zeros((worlds, joints), wp.float64) for _ in range(2)]
        self._projected = zeros((worlds, joints), wp.float64)
        self._dq = zeros((worlds, joints), wp.float32)
        self._gain = zeros((worlds, joints), wp.float32)
        own = np.ones(joints) if factors is None else np.asarray(factors, dtype=np.float64)
        self._factor = wp.array(np.tile(own, (worlds, 1)), dtype=wp.float64, device=device)
        unit = np.divide(1.0, own, out=np.zeros(joints), where=own > 0).astype(np.float32)
        self._unit = wp.array(np.tile(unit, (worlds, 1)), dtype=wp.float32, device=device)
        self._record()
        self.reset()

    @property
    def energies(self) -> wp.array:
        """E_e and E_u (B, H, W) of vec2 [px^2]."""
        return self._energy[self._now]

    def reset(self) -> None:
        """Forget all evidence."""
        self._now = 0
        self.frames = 0
        self._jacobian[0].zero_()
        self._energy[0].zero_()
        prior = self.options.initial_variance * np.eye(self.joints)
        self._covariance[0].assign(np.broadcast_to(prior, self._covariance[0].shape))

    def observe(self, flow: wp.array, dq: np.ndarray) -> None:
        """Take a frame: flow (B, H, W) of vec2 [px] and joint step (B, N) float32 [rad]."""
        wp.copy(self.flow, flow)
        self._dq.assign(dq)
        now = self._now
        self._update_gain[now].launch()
        self._predict[now]()
        self._update[now]()
        self._now = 1 - now
        self.frames += 1

    def label(self, jacobian: wp.array, min_jacobian: float) -> wp.array:
        """Label every pixel: 1 own body, 0 not, -1 unknown, (B, H, W) int8.

        Args:
            jacobian: (B, H, W) of (2, N).
            min_jacobian: Frobenius norm that the body's exceeds, in standard units [px/rad].
        """
        options = self.options
        self._label(jacobian, [options.unexplained, options.least_energy, min_jacobian**2], self.labels)
        return self.labels

    def unexplained(self) -> np.ndarray:
        """E_e / E_u, float32 (B, H, W); may exceed 1, NaN where nothing is known."""
        error, motion = np.moveaxis(self.energies.numpy(), -1, 0)
        known = np.maximum(error, motion) > self.options.least_energy
        share = np.full(error.shape, np.nan, np.float32)
        np.divide(error, np.maximum(motion, np.finfo(np.float32).tiny), out=share, where=known)
        return share

    def moved(self, least_jacobian: float) -> np.ndarray:
        """Whether the filter's own J is larger than that [px/rad, in standard units], bool (B, H, W)."""
        self._label(self._jacobian[self._now], [_ANY_SHARE, -1.0, least_jacobian**2], self._flags)
        return self._flags.numpy() == 1

    def finite(self, jacobian: wp.array) -> np.ndarray:
        """Whether all of J (B, H, W) of (2, N) is, bool (B, H, W)."""
        self._label(jacobian, [0.0, -1.0, 0.0], self._flags)
        return self._flags.numpy() >= 0

    def _label(self, jacobian: wp.array, bounds: list[float], labels: wp.array) -> None:
        unit = seen_as(self._unit, self._kernels.JointVector, self._unit.shape[:1])
        arguments = [jacobian, self.energies, unit, *bounds, labels]
        PixelLaunch(self._kernels.label_motion, self.shape, arguments, self.device, self.threads)()

    def _record(self) -> None:
        options, kernels = self.options, self._kernels
        dq, gain = (seen_as(array, kernels.JointVector, array.shape[:1]) for array in (self._dq, self._gain))
        noises = [options.process_noise, 0.0, options.measurement_noise, options.initial_variance, 0.0, 0.0]
        constants = [options.decay, options.rest, options.still, options.due]
        self._update_gain: list[Any] = []
        self._predict, self._update = [], []
        for now in range(2):
            jacobian, energy = self._jacobian[now], self._energy[now]
            self._predict.append(self._pixels(kernels.predict_motion, [jacobian, dq, self._motion]))
            inputs = [jacobian, energy, self._motion, self.flow, gain, *constants]
            outputs = [self._jacobian[1 - now], self._energy[1 - now]]
            self._update.append(self._pixels(kernels.update_motion, [*inputs, *outputs]))
            inputs = [self._dq, self._dq, self._covariance[now], self._displacement[now], self._factor, *noises]
            outputs = [self._projected, self._covariance[1 - now], self._displacement[1 - now], self._gain]
            self._update_gain.append(
                wp.launch(
                    update_shared_covariance,
                    dim=self.shape[0],
                    inputs=inputs,
                    outputs=outputs,
                    device=self.device,
                    record_cmd=True,
                )
            )

    def _pixels(self, kernel: Any, arguments: list[Any]) -> PixelLaunch:
        return PixelLaunch(kernel, self.shape, arguments, self.device, self.threads)
