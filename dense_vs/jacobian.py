"""The dense image Jacobian estimator: a Kalman filter at every pixel, DIJE section III.

``u = J dq`` relates the optical flow u [px] of a pixel to the joint step dq [rad] between two frames (1).
Each frame the estimate is moved with the image (13), (14) and corrected by the flow (9) to (12). Beyond the
paper, and measured better: one full covariance that all pixels share, for it holds no image data; the image
Hessian dJ/dq estimated beside J, so that J follows the posture (both in ``kernels/covariance.py``); process
noise that grows with the motion; a second step of the fixed point that (14) begins.
"""

import json
import os
from collections.abc import Callable
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import warp as wp

from dense_vs.arrays import points_array, real_vector, vec2_image
from dense_vs.device import resolve_device, resolve_threads
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays
from dense_vs.jacobian_options import JacobianOptions
from dense_vs.kernels.covariance import fixed_gain, regressors, update_shared_covariance
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

    The variance stays in place while J moves, as in the paper; shared by all pixels it would not change if it moved.

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
        assert self.options.order is not None  # the options have resolved it
        self._kernels = jacobian_kernels(self.options.joints, self.options.order)
        self._shape = (self.options.worlds, self.options.height, self.options.width)
        self._allocate()
        self._record_launches()
        self.reset()

    @property
    def jacobian(self) -> Any:
        """J, float32 ``(H, W, 2, N)`` [px/rad]: rows x and y, a column a joint.

        On a CPU a read-only NumPy view, valid until the next ``update``: copy what is to be kept. On a
        GPU a Warp array that stays there (``.numpy()`` reads it back, dlpack shares it).
        """
        state: Any = self._state[self._now]
        if self.device.is_cpu:
            return self._unbatch(_read_only(state.numpy()[..., : self.options.joints]))
        scalars = wp.array(
            ptr=state.ptr,
            dtype=wp.float32,
            shape=(*self._shape, 2, self.options.joints),
            strides=(*state.strides, 4 * self._kernels.columns, 4),
            device=self.device,
        )
        scalars._source = state  # the view does not own the memory
        return scalars[0] if self.options.worlds == 1 else scalars

    def to_numpy(self) -> np.ndarray:
        """J as NumPy, ``(H, W, 2, N)``: the view of :attr:`jacobian` on a CPU, a copy from a GPU."""
        jacobian = self.jacobian
        return jacobian if self.device.is_cpu else jacobian.numpy()

    @property
    def variance(self) -> np.ndarray:
        """Variance of each column of J, float32 ``(H, W, N)`` [px^2/rad^2], the same for its x and y rows (6)."""
        form = self.options.covariance
        if form == "diagonal":
            variance = self._covariance[self._now].numpy()
        elif form == "full":
            variance = np.diagonal(self._covariance[self._now].numpy(), axis1=-2, axis2=-1)
        else:
            shared = np.diagonal(self._covariance[self._now].numpy(), axis1=1, axis2=2)[:, : self.options.joints]
            variance = np.broadcast_to(shared.astype(np.float32)[:, None, None], (*self._shape, self.options.joints))
        return self._unbatch(_read_only(variance))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of a row of J: float64 ``(N, N)`` for ``"shared"`` and ``"fixed"``, float32
        ``(H, W, N, N)`` for ``"full"`` and ``"diagonal"`` [px^2/rad^2].
        """
        stored = self._covariance[self._now].numpy()
        if self.options.covariance == "diagonal":
            stored = stored[..., None] * np.eye(self.options.joints, dtype=np.float32)
        joints = self.options.joints
        return self._unbatch(stored[..., :joints, :joints].copy())

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
        bad = int(self._bad.numpy().sum())
        if self.options.on_bad_flow == "error" and bad:
            self._bad.zero_()
            raise DenseVSError(
                f"flow has {bad} pixels that are not finite; expected finite values, or "
                "DenseJacobian(on_bad_flow='skip')"
            )
        self._dq.assign(joint_step)
        self._regress()
        self._update_gain[self._now]()
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
        row = np.zeros((self.options.worlds, self._kernels.columns), dtype=np.float32)
        row[:, : self.options.joints] = self._joint_step(dq)
        regressor = wp.array(row, dtype=self._kernels.StateRow, device=self.device)
        vec2: Any = wp.vec2
        out = wp.empty(self._shape, dtype=vec2, device=self.device)
        arguments = [self._state[self._now], regressor, out]
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
        out = wp.empty(at.shape, dtype=self._kernels.State, device=self.device)
        inputs = [self._state[self._now], at]
        wp.launch(self._kernels.sample_points, dim=at.shape, inputs=inputs, outputs=[out], device=self.device)
        return self._unbatch(out.numpy()[..., : self.options.joints].copy())

    def reset(self) -> None:
        """Forget everything: J = 0 and H = 0 with their initial variances."""
        initial = self.options.initial_variance
        self._now = 0
        self._state[0].zero_()
        if self.options.covariance == "diagonal":
            self._covariance[0].fill_(initial)
        else:
            columns, joints = self._kernels.columns, self.options.joints
            variances = np.where(np.arange(columns) < joints, initial, self.options.initial_hessian_variance)
            cells = self._shape if self.options.covariance == "full" else self._shape[:1]
            self._covariance[0].assign(np.broadcast_to(np.diag(variances), (*cells, columns, columns)))
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
                state=self._state[self._now].numpy(),
                covariance=self._covariance[self._now].numpy(),
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, device: str = "auto", threads: int | None = None) -> "DenseJacobian":
        """Read what :meth:`save` wrote; the estimate goes on as if it had never stopped.

        Raises:
            DenseVSError: not such a file, another version of it, or arrays that do not fit its options.
        """
        content = read_arrays(path, "a saved Jacobian")
        if str(content.get("format")) != FORMAT:
            raise DenseVSError(f"{path} is not a saved Jacobian; expected a file that DenseJacobian.save wrote")
        if str(content.get("format_version")) != str(FORMAT_VERSION):
            raise DenseVSError(f"{path} has format version {content.get('format_version')}; expected {FORMAT_VERSION}")
        try:
            options = asdict(JacobianOptions(**json.loads(str(content["options"]))))
            state, covariance = content["state"], content["covariance"]
            updates = int(content["updates"])
        except (KeyError, ValueError, TypeError) as error:
            raise DenseVSError(f"{path} is damaged: {error}") from error
        estimator = cls(device=device, threads=threads, **options)
        for name, array, expected in (
            ("state", state, estimator._state[0].numpy()),
            ("covariance", covariance, estimator._covariance[0].numpy()),
        ):
            if array.shape != expected.shape or array.dtype != expected.dtype or not np.isfinite(array).all():
                raise DenseVSError(
                    f"{path} is damaged: {name} has shape {array.shape} and dtype {array.dtype}; "
                    f"expected finite values of shape {expected.shape} and dtype {expected.dtype}"
                )
        estimator._state[0].assign(state)
        estimator._covariance[0].assign(covariance)
        estimator.updates = updates
        return estimator

    def _allocate(self) -> None:
        worlds, columns = self.options.worlds, self._kernels.columns
        kernels, device = self._kernels, self.device
        self._state = [wp.zeros(self._shape, dtype=kernels.State, device=device) for _ in range(2)]
        shape, dtype = {
            "diagonal": (self._shape, kernels.JointVector),
            "full": (self._shape, kernels.Covariance),
        }.get(self.options.covariance, ((worlds, columns, columns), wp.float64))
        self._covariance = [wp.zeros(shape, dtype=dtype, device=device) for _ in range(2)]
        if self.options.covariance == "fixed":
            self._covariance[1] = self._covariance[0]
        self._flow = wp.zeros(self._shape, dtype=wp.vec2, device=device)
        self._bad = wp.zeros(self._shape[:2], dtype=int, device=device)
        self._dq = wp.zeros((worlds, self.options.joints), dtype=wp.float32, device=device)
        self._regressor = wp.zeros((worlds, columns), dtype=wp.float32, device=device)
        self._gain = wp.zeros((worlds, columns), dtype=wp.float32, device=device)
        self._projected = wp.zeros((worlds, columns), dtype=wp.float64, device=device)
        self._model_flow = wp.zeros(self._shape, dtype=wp.vec2, device=device)

    def _record_launches(self) -> None:
        """Bind every kernel to its arrays, once for each of the two roles of the double buffers."""
        options, kernels = self.options, self._kernels
        dq = _as_vectors(self._dq, kernels.JointVector)
        regressor, gain = (_as_vectors(array, kernels.StateRow) for array in (self._regressor, self._gain))
        displacement, iterations = {
            "model": (self._model_flow, options.prediction_iterations),
            "flow": (self._flow, 1),
            "none": (self._flow, 0),
        }[options.prediction]
        noises = [options.process_noise, options.drift_noise, options.measurement_noise, options.max_variance]

        self._count_bad = self._pixels(count_bad_flow, [self._flow, self._bad])
        self._regress = self._worlds(regressors, [self._dq, self._regressor], kernels.columns)
        self._update_gain, self._predict, self._correct = [], [], []
        for now in range(2):
            state, covariance = self._state[now], self._covariance[now]
            next_state, next_covariance = self._state[1 - now], self._covariance[1 - now]
            self._predict.append(self._pixels(kernels.predicted_flow, [state, regressor, self._model_flow]))
            self._update_gain.append(self._record_gain(covariance, next_covariance, noises))
            moved = [displacement, iterations]
            if options.covariance == "diagonal":
                moved.append(int(options.move_variance))
            if options.covariance in ("diagonal", "full"):
                kernel = kernels.update_diagonal if options.covariance == "diagonal" else kernels.update_full
                arguments = [state, covariance, *moved, self._flow, dq, *noises, next_state, next_covariance]
            else:
                kernel = kernels.update_shared
                arguments = [state, *moved, self._flow, dq, regressor, gain, next_state]
            self._correct.append(self._pixels(kernel, arguments))

    def _record_gain(self, covariance: wp.array, next_covariance: wp.array, noises: list[Any]) -> Callable[[], None]:
        """The launch that computes the image's one gain; nothing where each pixel has its own."""
        options = self.options
        if options.covariance == "shared":
            hessian = [options.hessian_noise, options.initial_hessian_variance]
            outputs = [self._projected, next_covariance, self._gain]
            return self._worlds(update_shared_covariance, [self._dq, covariance, *noises, *hessian, *outputs])
        if options.covariance == "fixed":
            weights = [options.initial_variance, options.measurement_noise]
            return self._worlds(fixed_gain, [self._dq, *weights, self._gain])
        return lambda: None

    def _pixels(self, kernel: Any, arguments: list[Any]) -> Callable[[], None]:
        return PixelLaunch(kernel, self._shape, arguments, self.device, self.threads)

    def _worlds(self, kernel: Any, arguments: list[Any], per_world: int | None = None) -> Callable[[], None]:
        dim = self.options.worlds if per_world is None else (self.options.worlds, per_world)
        command: Any = wp.launch(kernel, dim=dim, inputs=arguments, device=self.device, record_cmd=True)
        return command.launch

    def _joint_step(self, dq: Any) -> np.ndarray:
        worlds, joints = self.options.worlds, self.options.joints
        step = real_vector(dq, "dq", (joints,) if worlds == 1 else (worlds, joints), np.float32)
        return step.reshape(worlds, joints)

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
