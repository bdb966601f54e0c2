"""The dense image Jacobian estimator: a Kalman filter at every pixel, DIJE section III.

``u = J dq`` relates the optical flow u [px] of a pixel to the joint step dq [rad] between two frames, DIJE (1); it is
the observation of the filter, DIJE (2), DIJE (3), DIJE (4). Each frame the estimate is moved with the image, DIJE (8)
by (13) or (14), and corrected by the flow, DIJE (9) to (12). Beyond the paper, and measured better: one full covariance
in place of the diagonal one of DIJE (5), shared by all pixels, as it depends on no image data; the image Hessian dJ/dq
estimated beside J, so that J follows the posture (both in ``kernels/jacobian/covariance.py``); process noise that
grows with the motion; a second step of the fixed point that DIJE (14) begins.
"""

import os
from dataclasses import asdict
from typing import Any

import numpy as np
import warp as wp

from dense_vs.arrays import points_array, real_vector, share_image, vec2_image
from dense_vs.checks import check_flag
from dense_vs.device import NotCopied, resolve_device, resolve_threads, room_for
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write
from dense_vs.jacobian.blending import blending
from dense_vs.jacobian.depth_filter import DepthFilter, depth_bytes
from dense_vs.jacobian.depth_image import depth_image
from dense_vs.jacobian.filter import JacobianFilter, filter_bytes
from dense_vs.jacobian.jacobian_file import file_header, read_jacobian
from dense_vs.jacobian.options import CovarianceForm, JacobianOptions, OnBadFlow, Prediction, refuse_large_steps
from dense_vs.jacobian.uncertainty import own_covariance, own_variance
from dense_vs.kernels.views import seen_as

MOST_AWAY = 50.0  # rad in standard units, of a joint from the posture that the filter's state belongs to


class DenseJacobian(NotCopied):
    """Estimates, frame by frame, how every pixel of the image answers to every joint.

    Units are px and rad (m for a prismatic joint). Only the ratios of the three variances matter: scaling all of
    them leaves J as it is.

    Args:
        height, width: image size [px].
        joints: number of joints N.
        worlds: independent estimates kept side by side.
        order: 2 also estimates the image Hessian dJ/dq, so that J follows the posture; 1 takes J as constant at a point
            of the body, as the paper does. 2 unless given, for ``"shared"`` with up to 6 joints.
        covariance: ``"shared"``, one full N x N matrix for the image; ``"diagonal"``, a variance per pixel and joint,
            DIJE (9) to (11); ``"fixed"``, the constant weight of DIJE (12); ``"full"``, an N x N matrix per pixel.
        prediction: what J is moved by: ``"model"``, J dq, DIJE (14); ``"flow"``, DIJE (13); ``"nearest"``, whichever of
            the two fits the flow better (default of ``"shared"``; the others' is ``"model"``); ``"none"``.
        prediction_iterations: steps of y = x - J(y) dq in ``"model"``, 1 to 3; 1 is DIJE (14) as printed.
        process_noise: variance that J gains per squared joint step [px^2/rad^4]; 300 unless given, 1e4 in order 1.
        drift_noise: variance that J gains per update, q of DIJE (9) [px^2/rad^2].
        measurement_noise: variance r of a flow component [px^2]; rho of DIJE (12) in ``"fixed"``.
        initial_variance: p0 [px^2/rad^2]; the weight W of DIJE (12) in ``"fixed"``.
        hessian_noise: variance that H gains per squared joint step [px^2/rad^6].
        initial_hessian_variance: variance of H at the start, and its bound [px^2/rad^4].
        max_variance: bound on a variance of J [px^2/rad^2]; ``initial_variance`` unless given.
        joint_scale: typical step of each joint between two images in its own unit, N numbers; 0 for a joint that is
            not learned. J then does not depend on the joints' units; steps in rad are expected without it.
        rest: where neither the flow nor J dq reaches it, J fades to zero [px]; 0 learns from every flow.
        max_innovation: bound on the length of u - J dq as a multiple of that of u plus 0.5 px; none unless given.
        max_joint_step: largest step of a joint between two images that is believed [rad], in standard units with a
            ``joint_scale``; a larger one is refused.
        move_variance: whether ``"diagonal"`` moves the variance with J.
        on_bad_flow: ``"error"`` refuses a flow with a value that is not finite; ``"skip"`` only predicts there.
        depth: whether J has a third row, of depth images, see :attr:`depth_jacobian`; for ``"shared"``.
        depth_noise: standard deviation of a depth image at the robot [m].
        device: ``"auto"``, ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads; ``DENSE_VS_THREADS`` or all allowed cores unless given. Any number gives the same bits.

    Raises:
        DenseVSError: an option out of range, or a GPU whose memory does not suffice.

    The variance stays in place while J moves, as in the paper; shared by all pixels it would not change if it moved.

    Arrays lead with ``worlds`` where that is above 1. J starts at zero; until the joint steps have spanned all N
    dimensions (see :class:`dense_vs.Babbling`) it is not to be used.
    """

    def __init__(
        self,
        *,
        height: int,
        width: int,
        joints: int,
        worlds: int = 1,
        order: int | None = None,
        covariance: CovarianceForm = "shared",
        prediction: Prediction | None = None,
        prediction_iterations: int = 2,
        process_noise: float | None = None,
        drift_noise: float = 0.0,
        measurement_noise: float = 0.01,
        initial_variance: float = 1e4,
        hessian_noise: float = 1000.0,
        initial_hessian_variance: float = 1e4,
        max_variance: float | None = None,
        joint_scale: Any = None,
        rest: float = 0.0,
        max_innovation: float | None = None,
        max_joint_step: float = 100.0,
        move_variance: bool = False,
        on_bad_flow: OnBadFlow = "error",
        depth: bool = False,
        depth_noise: float = 0.006,
        device: str = "auto",
        threads: int | None = None,
    ):
        self.options = JacobianOptions(
            height=height,
            width=width,
            joints=joints,
            worlds=worlds,
            order=order,
            covariance=covariance,
            prediction=prediction,
            prediction_iterations=prediction_iterations,
            process_noise=process_noise,
            drift_noise=drift_noise,
            measurement_noise=measurement_noise,
            initial_variance=initial_variance,
            hessian_noise=hessian_noise,
            initial_hessian_variance=initial_hessian_variance,
            max_variance=max_variance,
            joint_scale=joint_scale,
            rest=rest,
            max_innovation=max_innovation,
            max_joint_step=max_joint_step,
            move_variance=move_variance,
            on_bad_flow=on_bad_flow,
            depth=depth,
            depth_noise=depth_noise,
        )
        self.device = resolve_device(device)
        self.threads = resolve_threads(threads)
        size = filter_bytes(self.options) + depth_bytes(self.options)
        with room_for("a dense image Jacobian", self.options.worlds, size, self.device):
            self.filter = JacobianFilter(self.options, self.device, self.threads, spans=self.takes_spans)
            self._depth = DepthFilter(self.options, self.device, self.threads) if self.options.depth else None
        self.updates = 0
        self._away = np.zeros((self.options.worlds, self.options.joints))  # from the filter's reference posture [rad]

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
        return seen_as(present, wp.float32, shape)

    def to_numpy(self) -> np.ndarray:
        """J as NumPy, ``(H, W, 2, N)``: the view of :attr:`jacobian` on a CPU, a copy from a GPU."""
        jacobian = self.jacobian
        return jacobian if self.device.is_cpu else jacobian.numpy()

    @property
    def depth(self) -> np.ndarray:
        """Depth of every pixel by all depth images so far, float32 ``(H, W)`` [m]; NaN where it is not known.

        A hole in the last image is bridged by what was seen before, moved by the joint steps.

        Raises:
            DenseVSError: made without ``depth``.
        """
        return self._unbatch(self._with_depth().depth)

    @property
    def depth_jacobian(self) -> np.ndarray:
        """J's third row, how depth answers to every joint, float32 ``(H, W, N)`` [m/rad]; a view as :attr:`jacobian`.

        Raises:
            DenseVSError: made without ``depth``.
        """
        return self._unbatch(_read_only(self._with_depth().jacobian))

    def _with_depth(self) -> DepthFilter:
        if self._depth is None:
            raise DenseVSError("estimator has no depth; expected DenseJacobian(depth=True)")
        return self._depth

    @property
    def variance(self) -> np.ndarray:
        """Variance of J's columns, float32 ``(H, W, N)`` [px^2/rad^2], the same for rows x and y, DIJE (6), DIJE (7).

        Infinite for a joint that is not learned.
        """
        return self._unbatch(_read_only(own_variance(self.filter)))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of a row of J: float64 ``(N, N)`` for ``"shared"`` and ``"fixed"``, float32
        ``(H, W, N, N)`` for ``"full"`` and ``"diagonal"`` [px^2/rad^2].
        """
        return self._unbatch(own_covariance(self.filter))

    @property
    def learned(self) -> np.ndarray:
        """Which joints are learned, bool ``(N,)``; the columns of the others stay zero, see ``joint_scale``."""
        return self._factors > 0

    @property
    def _factors(self) -> np.ndarray:
        return np.array(self.options.step_factors)

    @property
    def skipped_pixels(self) -> int | np.ndarray:
        """Pixels whose flow was not finite in the last update, by world."""
        counts = self.filter.bad.numpy().sum(axis=1)
        return int(counts[0]) if self.options.worlds == 1 else counts

    @property
    def takes_spans(self) -> bool:
        """Whether a flow may span more than a frame: with a covariance that all pixels share and J moved by J dq."""
        return self.options.covariance == "shared" and self.options.prediction != "flow"

    def update(self, flow: Any, dq: Any, span: Any = None, depth: Any = None) -> None:
        """Take one frame: move J with the image, DIJE (8), then correct it by the flow, DIJE (10).

        Args:
            flow: ``(H, W, 2)`` float32 [px per frame], stored at the pixels of the present frame and pointing
                from where a point was to where it is.
            dq: ``(N,)`` floating point [rad], the joint displacement between the two frames' time stamps.
            span: ``(N,)`` floating point [rad], the joint displacement from the flow's first image to the present one
                where that image lies further back than the last frame; ``dq`` unless given. Where little moves in a
                frame, such a flow says more: its errors hardly grow with the distance moved (beyond the paper).
            depth: ``(H, W)`` floating point [m], depth image of the present frame, 0 or NaN where it is not known; for
                an estimator with ``depth``, which only predicts it in a frame without.

        Raises:
            DenseVSError: shape, dtype, a value that is not finite, a step above ``max_joint_step``; a span where
                :attr:`takes_spans` is false; a depth image as of :func:`.depth_image.depth_image`; the estimate stays
                as it was.

        Flow of 2^17 px and more is no flow, as one that is not finite.
        """
        joint_step = self._joint_step(dq)
        spanned = None if span is None else self._span(span)
        measured = self._depth_image(depth)
        self.filter.stage(vec2_image(flow, "flow", self.filter.shape, self.device))
        if self.options.on_bad_flow == "error" and (bad := int(self.filter.bad.numpy().sum())):
            self.filter.bad.zero_()
            raise DenseVSError(
                f"flow has {bad} pixels that are not finite; expected finite values, or "
                "DenseJacobian(on_bad_flow='skip')"
            )
        self._advance(joint_step, spanned, measured)

    def predict(self, dq: Any, depth: Any = None) -> None:
        """Take one frame without its flow: move J with the image, its uncertainty growing; a later flow may span it.

        Raises:
            DenseVSError: as for :meth:`update`.
        """
        joint_step = self._joint_step(dq)
        self._advance(joint_step, self._span(np.zeros(np.shape(dq))), self._depth_image(depth))

    def blend(self, jacobian: Any, share: Any) -> None:
        """Draw J to one that is known from elsewhere, as from a body model; the uncertainty stays. For one world.

        Args:
            jacobian: ``(H, W, 2, N)`` [px/rad]; or what draws a :class:`.PresentState` on this device to it by a share.
            share: ``(H, W)``, 0 leaves J as it is, 1 takes the other.

        Raises:
            DenseVSError: several worlds, another shape, values that are not finite, a share out of 0 to 1.
        """
        size = self.options.height, self.options.width
        if self.options.worlds != 1:
            raise DenseVSError(f"estimator has {self.options.worlds} worlds; expected one to blend J in")
        weight = share_image(share, size)
        if not callable(draw := jacobian):
            other = real_vector(jacobian, "jacobian", (*size, 2, self.options.joints), np.float32, copy=False)
            draw = blending(other, self.filter.threads)
        self.filter.change(lambda present: draw(present, np.ascontiguousarray(weight)))

    def predicted_flow(self, dq: Any) -> np.ndarray:
        """The flow J dq that a joint step would cause, float32 ``(H, W, 2)`` [px].

        Raises:
            DenseVSError: ``dq`` is not N finite floating-point numbers.
        """
        return self._unbatch(self.filter.predicted_flow(self._joint_step(dq)).numpy().copy())

    def at(self, points: Any, *, depth: bool = False) -> np.ndarray:
        """J at image points by bilinear interpolation, DIJE (16).

        Args:
            points: ``(K, 2)`` x, y [px], ``(worlds, K, 2)`` for several worlds; outside the image the nearest
                border pixel answers.
            depth: whether the row of depth is wanted too; it is not averaged across a jump of depth.

        Returns:
            float32 ``(K, 2, N)`` [px/rad]; ``(K, 3, N)`` with depth [m/rad] as the third row.
        """
        worlds, depth = self.options.worlds, check_flag("depth", depth)
        if worlds == 1:
            batch = points_array(points, "points")[None]
        else:
            batch = real_vector(points, "points", (worlds, -1, 2))
        rows = self.filter.at(batch).numpy().copy()
        if depth:
            rows = np.concatenate([rows, self._with_depth().at(batch)[..., None, :]], axis=-2)
        return self._unbatch(rows)

    def reset(self) -> None:
        """Forget everything: J = 0 and H = 0 with their initial variances."""
        self.filter.reset()
        if self._depth is not None:
            self._depth.reset()
        self._away[...] = 0.0
        self.updates = 0

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the estimate and its options to an ``.npz`` file, whole or not at all.

        Raises:
            DenseVSError: the file cannot be written.
        """
        with atomic_write(path) as stream:
            np.savez(stream, **self.stored())

    def stored(self) -> dict[str, Any]:
        """The arrays that :meth:`save` writes, by name; on a CPU views, valid until the next ``update``."""
        depth = {} if self._depth is None else self._depth.stored()
        return self.filter.stored() | depth | file_header(self.options, self.updates)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, device: str = "auto", threads: int | None = None) -> "DenseJacobian":
        """Read what :meth:`save` wrote; the estimate goes on as if it had never stopped.

        Raises:
            DenseVSError: not such a file, another version of it, or arrays that do not fit its options.
        """
        options, updates, content = read_jacobian(path)
        estimator = cls(device=device, threads=threads, **asdict(options))
        estimator.filter.restore(content)
        if estimator._depth is not None:
            estimator._depth.restore(content)
        estimator._away = np.array(content["displacement"])
        estimator.updates = updates
        return estimator

    def _advance(self, joint_step: np.ndarray, span: np.ndarray | None, depth: np.ndarray | None) -> None:
        """Take a frame, from a reference posture so near that what float32 keeps of J + H d is J's."""
        if self.options.order == 2:
            away = self._away + joint_step
            if (np.abs(away) * self._factors > MOST_AWAY).any():
                self.filter.refer_to_present()
                away = joint_step.astype(np.float64)
            self._away = away
        self.filter.advance(joint_step, span)
        if self._depth is not None:
            self._depth.advance(self.filter, joint_step, depth)
        self.updates += 1

    def _depth_image(self, depth: Any) -> np.ndarray | None:
        """The image as (worlds, H, W) float32."""
        if depth is None:
            return None
        self._with_depth()
        shape = self.filter.shape
        return depth_image(depth, shape[1:] if self.options.worlds == 1 else shape).reshape(shape)

    def _span(self, span: Any) -> np.ndarray:
        if not self.takes_spans:
            raise DenseVSError(
                f"flow that spans more or less than a frame, covariance {self.options.covariance!r} and prediction "
                f"{self.options.prediction!r}; expected covariance 'shared' and prediction 'model' or 'none'"
            )
        return self._checked_step(span, "span")

    def _joint_step(self, dq: Any) -> np.ndarray:
        return self._checked_step(dq, "dq")

    def _checked_step(self, value: Any, name: str) -> np.ndarray:
        """A joint displacement (worlds, N) float32 that a robot can have made."""
        worlds, joints = self.options.worlds, self.options.joints
        step = real_vector(value, name, (joints,) if worlds == 1 else (worlds, joints), np.float32)
        refuse_large_steps(step, name, self._factors, self.options.max_joint_step)
        return step.reshape(worlds, joints)

    def _unbatch(self, array: np.ndarray) -> np.ndarray:
        return array[0] if self.options.worlds == 1 else array


def _read_only(array: np.ndarray) -> np.ndarray:
    view = array.view()
    view.flags.writeable = False
    return view
