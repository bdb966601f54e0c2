"""The dense image Jacobian estimator: a Kalman filter at every pixel, DIJE section III.

``u = J dq`` relates the optical flow u [px] of a pixel to the joint step dq [rad] between two frames (1).
Each frame the estimate is moved with the image (13), (14) and corrected by the flow (9) to (12). Beyond the
paper: one full covariance that all pixels share (it holds no image data, see ``kernels/covariance.py``),
process noise that grows with the motion, and a second step of the fixed point that (14) begins.
"""

import json
import os
import zipfile
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import warp as wp

from dense_vs.arrays import points_array, real_vector, vec2_image
from dense_vs.device import resolve_device, resolve_threads
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write
from dense_vs.jacobian_options import JacobianOptions
from dense_vs.kernels.covariance import fixed_gain, update_shared_covariance
from dense_vs.kernels.flow_field import count_bad_flow
from dense_vs.kernels.image_jacobian import jacobian_kernels
from dense_vs.kernels.launch import PixelLaunch, launch_pixels

FORMAT = "dense-vs dense image Jacobian"
FORMAT_VERSION = 1


class DenseJacobian:
    """Estimates, frame by frame, how every pixel of the image answers to every joint.

    Args:
        device: ``"auto"``, ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads; default ``DENSE_VS_THREADS`` or all allowed cores. Any number gives the same bits.
        options: the fields of :class:`JacobianOptions`; ``height``, ``width`` and ``joints`` are required.

    Raises:
        DenseVSError: an option that is unknown or out of range.

    Arrays lead with ``worlds`` where that is above 1. J starts at zero; until the joint steps have spanned all N
    dimensions (see :class:`dense_vs.Babbling`) it is not to be used.
    """

    def __init__(self, *, device: str = "auto", threads: int | None = None, **options: Any):
        known = [field.name for field in fields(JacobianOptions)]
        for name in options:
            if name not in known:
                raise DenseVSError(f"unknown option {name!r}; expected device, threads or {', '.join(known)}")
        for name in ("height", "width", "joints"):
            if name not in options:
                raise DenseVSError(f"option {name!r} is missing; height, width and joints are required")
        self.options = JacobianOptions(**options)
        self.device = resolve_device(device)
        self.threads = resolve_threads(threads)
        self._kernels = jacobian_kernels(self.options.joints)
        self._shape = (self.options.worlds, self.options.height, self.options.width)
        self._allocate()
        self._record_launches()
        self.reset()

    @property
    def jacobian(self) -> np.ndarray | wp.array:
        """J, float32 ``(H, W, 2, N)`` [px/rad]: rows x and y, a column a joint.

        On a CPU a read-only NumPy view, valid until the next ``update``: copy what is to be kept. On a
        GPU a Warp array that stays there (``.numpy()`` reads it back, dlpack shares it).
        """
        if not self.device.is_cpu:
            matrix = self._jacobian[self._now]
            return matrix[0] if self.options.worlds == 1 else matrix
        return self._unbatch(_read_only(self._jacobian[self._now].numpy()))

    @property
    def variance(self) -> np.ndarray:
        """Variance of each column of J, float32 ``(H, W, N)`` [px^2/rad^2], the same for its x and y rows (6)."""
        form = self.options.covariance
        if form == "diagonal":
            variance = self._covariance[self._now].numpy()
        elif form == "full":
            variance = np.diagonal(self._covariance[self._now].numpy(), axis1=-2, axis2=-1)
        else:
            shared = np.diagonal(self._covariance[self._now].numpy(), axis1=1, axis2=2).astype(np.float32)
            variance = np.broadcast_to(shared[:, None, None], (*self._shape, self.options.joints))
        return self._unbatch(_read_only(variance))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of a row of J: float64 ``(N, N)`` for ``"shared"`` and ``"fixed"``, float32
        ``(H, W, N, N)`` for ``"full"`` and ``"diagonal"`` [px^2/rad^2].
        """
        stored = self._covariance[self._now].numpy()
        if self.options.covariance == "diagonal":
            stored = stored[..., None] * np.eye(self.options.joints, dtype=np.float32)
        return self._unbatch(stored.copy())

    @property
    def skipped_pixels(self) -> int | np.ndarray:
        """Pixels whose flow was not finite in the last update, by world."""
        counts = self._bad.numpy().sum(axis=1)
        return int(counts[0]) if self.options.worlds == 1 else counts

    def update(self, flow: Any, dq: Any) -> None:
        """Take one frame: move J with the image, then correct it by the flow.

        Args:
            flow: ``(H, W, 2)`` float32 [px per frame], stored at the pixels of the present frame and pointing
                from where a point was to where it is.
            dq: ``(N,)`` floating point [rad], the joint displacement between the two frames' time stamps.

        Raises:
            DenseVSError: shape, dtype, or a value that is not finite; the estimate stays as it was.
        """
        joint_step = self._joint_step(dq)
        wp.copy(self._flow, vec2_image(flow, "flow", self._shape, self.device))
        self._bad.zero_()
        self._count_bad()
        if self.options.on_bad_flow == "error" and self._bad.numpy().any():
            raise DenseVSError(
                f"flow has {int(self._bad.numpy().sum())} pixels that are not finite; expected finite values, or "
                "DenseJacobian(on_bad_flow='skip')"
            )
        self._dq.assign(joint_step)
        self._gain_launch[self._now]()
        if self.options.prediction == "model":
            self._predict[self._now]()
        self._correct[self._now]()
        self._now = 1 - self._now
        self.updates += 1

    def predicted_flow(self, dq: Any) -> np.ndarray:
        """The flow J dq that a joint step would cause, float32 ``(H, W, 2)`` [px].

        Raises:
            DenseVSError: ``dq`` is not N finite floating-point numbers.
        """
        steps = wp.array(self._joint_step(dq), dtype=self._kernels.JointVector, device=self.device)
        out = wp.empty(self._shape, dtype=wp.vec2, device=self.device)
        arguments = [self._jacobian[self._now], steps, out]
        launch_pixels(self._kernels.predicted_flow, self._shape, arguments, self.device, self.threads)
        return self._unbatch(out.numpy())

    def at(self, points: Any) -> np.ndarray:
        """J at image points by bilinear interpolation (16).

        Args:
            points: ``(K, 2)`` x, y [px], ``(worlds, K, 2)`` for several worlds; outside the image the nearest
                border pixel answers.

        Returns:
            float32 ``(K, 2, N)`` [px/rad].
        """
        worlds = self.options.worlds
        if worlds == 1:
            batch = points_array(points, "points")[None]
        else:
            batch = real_vector(points, "points", (worlds, -1, 2))
        at = wp.array(batch.astype(np.float32), dtype=wp.vec2, device=self.device)
        out = wp.empty(at.shape, dtype=self._kernels.Jacobian, device=self.device)
        inputs = [self._jacobian[self._now], at]
        wp.launch(self._kernels.sample_points, dim=at.shape, inputs=inputs, outputs=[out], device=self.device)
        return self._unbatch(out.numpy())

    def reset(self) -> None:
        """Forget everything: J = 0, variance p0."""
        initial = self.options.initial_variance
        self._now = 0
        self._jacobian[0].zero_()
        if self.options.covariance == "diagonal":
            self._covariance[0].fill_(initial)
        else:
            shape = self._covariance[0].shape
            identity = initial * np.eye(self.options.joints)
            cells = shape if self.options.covariance == "full" else shape[:1]
            self._covariance[0].assign(np.broadcast_to(identity, (*cells, *identity.shape)))
        self._bad.zero_()
        self.updates = 0

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the estimate and its options to an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: the file cannot be written.
        """
        with atomic_write(path) as stream:
            np.savez(
                stream,
                format=FORMAT,
                format_version=FORMAT_VERSION,
                options=json.dumps(asdict(self.options)),
                updates=self.updates,
                jacobian=self._jacobian[self._now].numpy(),
                covariance=self._covariance[self._now].numpy(),
            )

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], *, device: str = "auto", threads: int | None = None
    ) -> "DenseJacobian":
        """Read what :meth:`save` wrote; the estimate goes on as if it had never stopped.

        Raises:
            DenseVSError: not such a file, another version of it, or arrays that do not fit its options.
        """
        try:
            with np.load(path, allow_pickle=False) as stored:
                content = {name: stored[name] for name in stored.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise DenseVSError(f"cannot read {path} as a saved Jacobian: {error}") from error
        if str(content.get("format")) != FORMAT:
            raise DenseVSError(f"{path} is not a saved Jacobian; expected a file that DenseJacobian.save wrote")
        if int(content.get("format_version", 0)) != FORMAT_VERSION:
            raise DenseVSError(
                f"{path} has format version {content.get('format_version')}; expected {FORMAT_VERSION}"
            )
        try:
            options = json.loads(str(content["options"]))
            jacobian, covariance = content["jacobian"], content["covariance"]
            updates = int(content["updates"])
        except (KeyError, ValueError) as error:
            raise DenseVSError(f"{path} is damaged: {error}") from error
        estimator = cls(device=device, threads=threads, **options)
        for name, array, expected in (
            ("jacobian", jacobian, estimator._jacobian[0].numpy()),
            ("covariance", covariance, estimator._covariance[0].numpy()),
        ):
            if array.shape != expected.shape or array.dtype != expected.dtype or not np.isfinite(array).all():
                raise DenseVSError(
                    f"{path} is damaged: {name} has shape {array.shape} and dtype {array.dtype}; "
                    f"expected finite values of shape {expected.shape} and dtype {expected.dtype}"
                )
        estimator._jacobian[0].assign(jacobian)
        estimator._covariance[0].assign(covariance)
        estimator.updates = updates
        return estimator

    def _allocate(self) -> None:
        worlds, joints = self.options.worlds, self.options.joints
        kernels, device = self._kernels, self.device
        self._jacobian = [wp.zeros(self._shape, dtype=kernels.Jacobian, device=device) for _ in range(2)]
        shape, dtype = {
            "diagonal": (self._shape, kernels.JointVector),
            "full": (self._shape, kernels.Covariance),
        }.get(self.options.covariance, ((worlds, joints, joints), wp.float64))
        self._covariance = [wp.zeros(shape, dtype=dtype, device=device) for _ in range(2)]
        if self.options.covariance == "fixed":
            self._covariance[1] = self._covariance[0]
        self._flow = wp.zeros(self._shape, dtype=wp.vec2, device=device)
        self._bad = wp.zeros(self._shape[:2], dtype=int, device=device)
        self._dq = wp.zeros((worlds, joints), dtype=wp.float32, device=device)
        self._gain = wp.zeros((worlds, joints), dtype=wp.float32, device=device)
        self._projected = wp.zeros((worlds, joints), dtype=wp.float64, device=device)
        self._model_flow = wp.zeros(self._shape, dtype=wp.vec2, device=device)

    def _record_launches(self) -> None:
        """Bind every kernel to its arrays, once for each of the two roles of the double buffers."""
        options, kernels = self.options, self._kernels

        def pixels(kernel: wp.Kernel, arguments: list[Any]) -> PixelLaunch:
            return PixelLaunch(kernel, self._shape, arguments, self.device, self.threads)

        dq, gain = (_as_vectors(array, kernels.JointVector) for array in (self._dq, self._gain))
        displacement, iterations = {
            "model": (self._model_flow, options.prediction_iterations),
            "flow": (self._flow, 1),
            "none": (self._flow, 0),
        }[options.prediction]
        noises = [options.process_noise, options.drift_noise, options.measurement_noise, options.max_variance]

        self._count_bad = pixels(count_bad_flow, [self._flow, self._bad])
        self._predict, self._correct, self._gain_launch = [], [], []
        for now in range(2):
            jacobian, covariance = self._jacobian[now], self._covariance[now]
            next_jacobian, next_covariance = self._jacobian[1 - now], self._covariance[1 - now]
            self._predict.append(pixels(kernels.predicted_flow, [jacobian, dq, self._model_flow]))
            self._gain_launch.append(self._record_gain(covariance, next_covariance, noises))
            moved = [displacement, iterations]
            if options.covariance == "diagonal":
                moved.append(int(options.move_variance))
            if options.covariance in ("diagonal", "full"):
                kernel = kernels.update_diagonal if options.covariance == "diagonal" else kernels.update_full
                arguments = [jacobian, covariance, *moved, self._flow, dq, *noises, next_jacobian, next_covariance]
            else:
                kernel = kernels.update_shared
                arguments = [jacobian, *moved, self._flow, dq, gain, next_jacobian]
            self._correct.append(pixels(kernel, arguments))

    def _record_gain(self, covariance: wp.array, next_covariance: wp.array, noises: list[float]) -> Any:
        """The launch that computes the image's one gain; nothing where each pixel has its own."""
        if self.options.covariance in ("diagonal", "full"):
            return lambda: None
        if self.options.covariance == "shared":
            kernel = update_shared_covariance
            arguments = [self._dq, covariance, *noises, self._projected, next_covariance, self._gain]
        else:
            kernel = fixed_gain
            arguments = [self._dq, self.options.initial_variance, self.options.measurement_noise, self._gain]
        launch = wp.launch(
            kernel, dim=self.options.worlds, inputs=arguments, device=self.device, record_cmd=True
        )
        return launch.launch

    def _joint_step(self, dq: Any) -> np.ndarray:
        worlds, joints = self.options.worlds, self.options.joints
        single = worlds == 1 and np.ndim(dq) == 1
        step = real_vector(dq, "dq", (joints,) if single or worlds == 1 else (worlds, joints))
        return step.reshape(worlds, joints).astype(np.float32)

    def _unbatch(self, array: np.ndarray) -> np.ndarray:
        return array[0] if self.options.worlds == 1 else array


def _as_vectors(array: wp.array, dtype: Any) -> wp.array:
    """A (worlds, N) float array seen as (worlds,) vectors; keeps the memory."""
    view = wp.array(ptr=array.ptr, dtype=dtype, shape=array.shape[:1], device=array.device)
    view._source = array
    return view


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view
