"""The dense image Jacobian estimator: a Kalman filter at every pixel, DIJE section III.

``u = J dq`` relates the optical flow u [px] of a pixel to the joint step dq [rad] between two frames (1).
Each frame the estimate is moved with the image (13), (14) and corrected by the flow (9) to (12). Beyond the
paper, and measured better: one full covariance that all pixels share, for it holds no image data; the image
Hessian dJ/dq estimated beside J, so that J follows the posture (both in ``kernels/covariance.py``); process
noise that grows with the motion; a second step of the fixed point that (14) begins.
"""

import json
import os
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import warp as wp

from dense_vs.arrays import points_array, real_vector, vec2_image
from dense_vs.device import resolve_device, resolve_threads, room_for
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays
from dense_vs.jacobian.filter import JacobianFilter, filter_bytes
from dense_vs.jacobian.options import JacobianOptions

FORMAT = "dense-vs dense image Jacobian"
FORMAT_VERSION = 1


class DenseJacobian:
    """Estimates, frame by frame, how every pixel of the image answers to every joint.

    Args:
        device: ``"auto"``, ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads; default ``DENSE_VS_THREADS`` or all allowed cores. Any number gives the same bits.
        options: the fields of :class:`JacobianOptions`; ``height``, ``width`` and ``joints`` are required.

    Raises:
        DenseVSError: an option that is unknown or out of range, or a GPU whose memory does not suffice.

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
        with room_for("a dense image Jacobian", self.options.worlds, filter_bytes(self.options), self.device):
            self.filter = JacobianFilter(self.options, self.device, self.threads)
        self.updates = 0

    @property
    def jacobian(self) -> Any:
        """J, float32 ``(H, W, 2, N)`` [px/rad]: rows x and y, a column a joint.

        On a CPU a read-only NumPy view, valid until the next ``update``: copy what is to be kept. On a
        GPU a Warp array that stays there (``.numpy()`` reads it back, dlpack shares it); for several worlds
        ``(worlds, H, W)`` of 2 x N matrices, as Warp's arrays have four dimensions at most.
        """
        present = self.filter.present()
        if self.device.is_cpu:
            return self._unbatch(_read_only(present.numpy()))
        if self.options.worlds > 1:
            return present
        shape = (self.options.height, self.options.width, 2, self.options.joints)
        scalars: Any = wp.array(ptr=present.ptr, dtype=wp.float32, shape=shape, device=self.device)
        scalars._source = present  # the view does not own the memory
        return scalars

    def to_numpy(self) -> np.ndarray:
        """J as NumPy, ``(H, W, 2, N)``: the view of :attr:`jacobian` on a CPU, a copy from a GPU."""
        jacobian = self.jacobian
        return jacobian if self.device.is_cpu else jacobian.numpy()

    @property
    def variance(self) -> np.ndarray:
        """Variance of each column of J, float32 ``(H, W, N)`` [px^2/rad^2], the same for its x and y rows (6)."""
        joints = self.options.joints
        stored = self.filter.covariance[self.filter.now].numpy()
        if self.options.covariance == "diagonal":
            variance = stored
        elif self.options.covariance == "full":
            variance = np.diagonal(stored, axis1=-2, axis2=-1)
        else:
            shared = np.diagonal(stored, axis1=1, axis2=2)[:, None, None, :joints].astype(np.float32)
            variance = np.broadcast_to(shared, (*self.filter.shape, joints))
        return self._unbatch(_read_only(variance))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of a row of J: float64 ``(N, N)`` for ``"shared"`` and ``"fixed"``, float32
        ``(H, W, N, N)`` for ``"full"`` and ``"diagonal"`` [px^2/rad^2].
        """
        stored = self.filter.covariance[self.filter.now].numpy()
        if self.options.covariance == "diagonal":
            stored = stored[..., None] * np.eye(self.options.joints, dtype=np.float32)
        joints = self.options.joints
        return self._unbatch(stored[..., :joints, :joints].copy())

    @property
    def skipped_pixels(self) -> int | np.ndarray:
        """Pixels whose flow was not finite in the last update, by world."""
        counts = self.filter.bad.numpy().sum(axis=1)
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
        self.filter.stage(vec2_image(flow, "flow", self.filter.shape, self.device))
        if self.options.on_bad_flow == "error" and (bad := int(self.filter.bad.numpy().sum())):
            self.filter.bad.zero_()
            raise DenseVSError(
                f"flow has {bad} pixels that are not finite; expected finite values, or "
                "DenseJacobian(on_bad_flow='skip')"
            )
        self.filter.advance(joint_step)
        self.updates += 1

    def predicted_flow(self, dq: Any) -> np.ndarray:
        """The flow J dq that a joint step would cause, float32 ``(H, W, 2)`` [px].

        Raises:
            DenseVSError: ``dq`` is not N finite floating-point numbers.
        """
        return self._unbatch(self.filter.predicted_flow(self._joint_step(dq)).numpy())

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
        return self._unbatch(self.filter.at(batch).numpy())

    def reset(self) -> None:
        """Forget everything: J = 0 and H = 0 with their initial variances."""
        self.filter.reset()
        self.updates = 0

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the estimate and its options to an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: the file cannot be written.
        """
        content: dict[str, Any] = dict(self.filter.stored())
        content |= {"format": FORMAT, "format_version": FORMAT_VERSION}
        content |= {"options": json.dumps(asdict(self.options)), "updates": self.updates}
        with atomic_write(path) as stream:
            np.savez(stream, **content)

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
            updates = int(content["updates"])
            estimator = cls(device=device, threads=threads, **options)
            stored = [(name, array, content[name]) for name, array in estimator.filter.stored().items()]
        except (KeyError, ValueError, TypeError) as error:
            raise DenseVSError(f"{path} is damaged: {error}") from error
        for name, expected, found in stored:
            if found.shape != expected.shape or found.dtype != expected.dtype or not np.isfinite(found).all():
                raise DenseVSError(
                    f"{path} is damaged: {name} has shape {found.shape} and dtype {found.dtype}; "
                    f"expected finite values of shape {expected.shape} and dtype {expected.dtype}"
                )
        estimator.filter.restore({name: found for name, _, found in stored})
        estimator.updates = updates
        return estimator

    def _joint_step(self, dq: Any) -> np.ndarray:
        worlds, joints = self.options.worlds, self.options.joints
        step = real_vector(dq, "dq", (joints,) if worlds == 1 else (worlds, joints), np.float32)
        return step.reshape(worlds, joints)

    def _unbatch(self, array: np.ndarray) -> np.ndarray:
        return array[0] if self.options.worlds == 1 else array


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view
