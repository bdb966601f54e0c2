"""The filter's arrays on the device and the launches that take it from one frame to the next.

State and covariance are double-buffered: a frame reads one half and writes the other, then they change roles. Every
launch is bound to its arrays once for each of the two roles, so that a frame allocates and packs nothing. On a GPU a
frame can be captured in a graph, one for each role.
"""

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np
import warp as wp

from dense_vs.jacobian.options import JacobianOptions
from dense_vs.jacobian.predicted_flow import PredictedFlow
from dense_vs.jacobian.sampled_points import SampledPoints
from dense_vs.kernels.image.flow_field import count_bad_flow
from dense_vs.kernels.image.tiles import tile_launch
from dense_vs.kernels.jacobian.covariance import (
    fixed_gain,
    forget_covariance,
    hessian_place,
    regressors,
    state_columns,
    update_shared_covariance,
)
from dense_vs.kernels.jacobian.image_jacobian import forget_state, jacobian_kernels
from dense_vs.kernels.jacobian.present_state import PresentState
from dense_vs.kernels.jacobian.state_image import Layout, group_size, variance_image
from dense_vs.kernels.launch import PixelLaunch
from dense_vs.kernels.recorded import recorded
from dense_vs.kernels.views import seen_as, write


class JacobianFilter:
    """State of B worlds with N joints and C columns on one device.

    Args:
        options: checked options.
        device: Warp device.
        threads: CPU threads.
        layout: of the state, see :mod:`dense_vs.kernels.jacobian.state_image`; ``"planes"`` on a GPU unless given.
        flow: (B, H, W) of vec2 that someone else fills; an array of its own unless given.
        spans: whether a flow may span more than a frame, or a frame have none; for a shared covariance.

    Attributes:
        shape: (B, H, W).
        state: two images of (2, C) states, at the reference posture.
        covariance: two of (B, C, C) float64; (B, H, W) of (N) or (N, N) float32 where each pixel has its own; variances
            in planes as the state.
        displacement: two of (B, N) float64, joint displacement from the reference posture [rad].
        factor: (B, N) float64, what brings each joint's step to standard units, 0 where it is not to be learned.
        now: which of each two is the present one.
        flow: (B, H, W) of vec2, of the frame that :meth:`advance` takes [px].
        dq: (B, N) float32, its joint step [rad].
        span: (B, N) float32, joint displacement that the flow spans [rad]; ``dq`` itself without ``spans``.
        version: another number for every state there was.
        bad: (B, H) int32, pixels of each row whose flow is not finite.
    """

    def __init__(
        self,
        options: JacobianOptions,
        device: wp.Device,
        threads: int,
        *,
        layout: Layout | None = None,
        flow: wp.array | None = None,
        spans: bool = False,
    ):
        assert options.order is not None  # the options have resolved it
        self.options, self.device, self.threads = options, device, threads
        self.layout: Layout = layout or ("matrices" if device.is_cpu else "planes")
        self.kernels = jacobian_kernels(options.joints, options.order, self.layout)
        self.shape = (options.worlds, options.height, options.width)
        self._present: Any = None
        self.version, self._present_version = 0, -1
        self._allocate(flow, spans)
        self._record()
        self.reset()

    def reset(self) -> None:
        """J = 0 and H = 0 with their initial variances, at the present posture."""
        self.now = 0
        self.version += 1
        self.state[0].zero_()
        self.displacement[0].zero_()
        self.bad.zero_()
        self._assign_covariance(self._initial_covariance())

    def stored(self) -> dict[str, np.ndarray]:
        """Arrays that the next frame depends on, by name: state (B, H, W, 2, C), its covariance, the displacement."""
        state = self.state[self.now].numpy()
        if self.layout == "planes":
            state = self._from_planes(state, self._group).reshape(*self.shape, 2, -1)
        displacement = self.displacement[self.now].numpy()
        return {"state": state, "covariance": self.stored_covariance(), "displacement": displacement}

    def stored_covariance(self) -> np.ndarray:
        """The present covariance, (B, C, C); (B, H, W, N) or (B, H, W, N, N) where each pixel has its own."""
        covariance = self.covariance[self.now].numpy()
        if self._variance_group:
            return self._from_planes(covariance, self._variance_group)[..., : self.options.joints]
        return covariance

    def restore(self, stored: dict[str, np.ndarray]) -> None:
        """Go on from what :meth:`stored` gave."""
        state, covariance = stored["state"], stored["covariance"]
        if self.layout == "planes":
            state = self._to_planes(state.reshape(*self.shape, -1), self._group)
        self.state[self.now].assign(np.ascontiguousarray(state))
        self._assign_covariance(covariance)
        self.displacement[self.now].assign(stored["displacement"])
        self.version += 1

    def _from_planes(self, planes: np.ndarray, group: int) -> np.ndarray:
        """(B, H, W, numbers) of what lies in planes of ``group`` numbers a pixel."""
        worlds, height, width = self.shape
        grouped = planes.reshape(worlds, -1, height, width, group)
        return np.moveaxis(grouped, 1, 3).reshape(worlds, height, width, -1)

    def _to_planes(self, numbers: np.ndarray, group: int) -> np.ndarray:
        worlds, height, width, count = numbers.shape
        padded = np.pad(numbers, ((0, 0), (0, 0), (0, 0), (0, -count % group)))
        grouped = np.moveaxis(padded.reshape(worlds, height, width, -1, group), 3, 1)
        return np.ascontiguousarray(grouped.reshape(-1, height, width, group))

    def _assign_covariance(self, covariance: np.ndarray) -> None:
        if self._variance_group:
            covariance = self._to_planes(covariance, self._variance_group)
        self.covariance[self.now].assign(covariance)

    def refer_to_present(self) -> None:
        """Keep J at the present posture in place of an earlier one; on the host, for a state of second order."""
        stored = self.stored()
        joints = self.options.joints
        state, away = stored["state"], stored["displacement"].astype(np.float32)
        for i, j in zip(*(side.tolist() for side in np.triu_indices(joints)), strict=True):
            hessian = state[..., hessian_place(i, j, joints)]
            state[..., i] += hessian * away[:, j, None, None, None]
            if i != j:
                state[..., j] += hessian * away[:, i, None, None, None]
        self.restore(stored | {"displacement": np.zeros_like(stored["displacement"])})

    def stage(self, flow: wp.array) -> None:
        """Take in the flow (B, H, W) of vec2 of the next frame and count its bad pixels; no state changes."""
        if self.device.is_cpu:
            write(self.flow, flow.numpy())
        else:
            wp.copy(self.flow, flow)
        self.bad.zero_()
        self._count_bad()

    def advance(self, joint_step: np.ndarray, span: np.ndarray | None = None) -> None:
        """Predict and correct by the staged flow and the joint step (B, N) float32 [rad].

        Args:
            joint_step: of the frame.
            span: joint displacement that the flow spans (B, N) float32 [rad], of a filter with ``spans``; the joint
                step unless given. With zeros the frame is predicted only.
        """
        write(self.dq, joint_step)
        if self.span is not self.dq:
            write(self.span, joint_step if span is None else span)
        self.advance_on_device()

    def advance_on_device(self) -> None:
        """Predict and correct by what ``flow`` and ``dq`` hold."""
        self.regress[self.now]()
        self.update_gain[self.now]()
        self.predict[self.now]()
        self.correct[self.now]()
        self.swap()

    def swap(self) -> None:
        """Let the two halves of the buffers change roles; for those who replay what they captured."""
        self.now = 1 - self.now
        self.version += 1

    def forget(self, where: wp.array) -> None:
        """J = 0 and H = 0 with their initial variances in the worlds where ``where`` (B,) int is not 0; for a
        covariance that all pixels of a world share.
        """
        now = self.now
        wp.launch(
            forget_state,
            dim=self._floats[now].shape[:2],
            inputs=[where],
            outputs=[self._floats[now]],
            device=self.device,
        )
        wp.launch(
            forget_covariance,
            dim=self.shape[0],
            inputs=[where, self.options.initial_variance, self.options.initial_hessian_variance],
            outputs=[self.covariance[now], self.displacement[now]],
            device=self.device,
        )
        self.version += 1

    def present(self) -> wp.array:
        """J at the present posture, (B, H, W) of (2, N); computed when first asked for where the state is another."""
        if self.options.order == 1 and self.layout == "matrices":
            return self.state[self.now]
        if self._present is None:
            self._present = wp.zeros(self.shape, dtype=self.kernels.Jacobian, device=self.device)
            self._read = [
                self._pixels(self.kernels.read_jacobian, [self.state[now], self.displacement[now], self._present])
                for now in range(2)
            ]
        if self._present_version != self.version:
            self._read[self.now]()
            self._present_version = self.version
        return self._present

    def change(self, how: Callable[[PresentState], Any]) -> None:
        """Let something change the present state in place."""
        how(PresentState(self.kernels, self.state[self.now], self.displacement[self.now]))
        self.version += 1

    def predicted_flow(self, joint_step: np.ndarray) -> wp.array:
        """J times a joint step (B, N) float32 [rad], (B, H, W) of vec2 [px]; valid until asked again."""
        return self._predicted_flow(joint_step, self.now, self.displacement[self.now].numpy())

    @cached_property
    def _predicted_flow(self) -> PredictedFlow:
        return PredictedFlow(self.kernels, self.state, self.flow, self.options.joints, self.threads)

    def guess_flow(self, out: wp.array, most: float) -> None:
        """What ``dq`` says of the next flow, nothing read back: J dq at the size of ``out`` (B, any, any) of vec2.

        Args:
            out: written [px of the image].
            most: length that is believed [px].
        """
        self.regress[self.now]()
        regressor = seen_as(self.regressor, self.kernels.StateRow, self.regressor.shape[:1])
        inputs = [self.state[self.now], regressor, most]
        wp.launch(self.kernels.coarse_flow, dim=out.shape, inputs=inputs, outputs=[out], device=self.device)

    def at(self, points: np.ndarray) -> wp.array:
        """J at points (B, K, 2) [px], (B, K) of (2, N); valid until asked again."""
        return self._sampled_points(points, self.now)

    @cached_property
    def _sampled_points(self) -> SampledPoints:
        return SampledPoints(self.kernels, self.state, self.displacement)

    def _allocate(self, flow: wp.array | None, spans: bool) -> None:
        options, kernels, device = self.options, self.kernels, self.device
        worlds, joints, columns = options.worlds, options.joints, kernels.columns
        height, width = options.height, options.width
        per_pixel = {"diagonal": kernels.JointVector, "full": kernels.Covariance}.get(options.covariance)

        def pair(shape: tuple[int, ...], dtype: Any) -> list[Any]:
            return [wp.zeros(shape, dtype=dtype, device=device) for _ in range(2)]

        self._group = group_size(columns)
        if self.layout == "planes":
            planes = 2 * columns // self._group * worlds
            self.state = pair((planes, height, width), wp.types.vector(self._group, wp.float32))
            shape = (planes, height, self._group * width)
        else:
            self.state = pair(self.shape, kernels.State)
            shape = (worlds, height, 2 * columns * width)
        self._floats = [seen_as(array, wp.float32, shape) for array in self.state]
        # 0 where the covariance is not in planes.
        self._variance_group = variance_image(joints).group if self._once and options.covariance == "diagonal" else 0
        if self._variance_group:
            group = self._variance_group
            self.covariance = pair((worlds * -(-joints // group), height, width), wp.types.vector(group, wp.float32))
        else:
            self.covariance = pair(self.shape, per_pixel) if per_pixel else pair((worlds, columns, columns), wp.float64)
        if options.covariance == "fixed":
            self.covariance[1] = self.covariance[0]
        self.displacement = pair((worlds, joints), wp.float64)
        factors = np.broadcast_to(np.array(options.step_factors, dtype=np.float64), (worlds, joints))
        self.factor = wp.array(np.ascontiguousarray(factors), dtype=wp.float64, device=device)
        vec2: Any = wp.vec2
        self.flow: Any = wp.zeros(self.shape, dtype=vec2, device=device) if flow is None else flow
        self.model_flow: Any = None if self._once else wp.zeros(self.shape, dtype=vec2, device=device)
        self.bad: Any = wp.zeros(self.shape[:2], dtype=wp.int32, device=device)
        self.dq = wp.zeros((worlds, joints), dtype=wp.float32, device=device)
        self.regressor = wp.zeros((worlds, columns), dtype=wp.float32, device=device)
        self.span = wp.zeros_like(self.dq) if spans else self.dq
        self.measured = wp.zeros_like(self.regressor) if spans else self.regressor
        self.gain = wp.zeros((worlds, columns), dtype=wp.float32, device=device)
        self.projected = wp.zeros((worlds, columns), dtype=wp.float64, device=device)

    @property
    def _once(self) -> bool:
        """Whether a frame is one pass, without an image of J dq."""
        return self.layout == "planes" and self.options.covariance != "full"

    def _initial_covariance(self) -> np.ndarray:
        options, columns = self.options, self.kernels.columns
        if options.covariance == "diagonal":
            return np.full((*self.shape, options.joints), options.initial_variance, dtype=np.float32)
        of_jacobian = np.arange(columns) < options.joints
        variances = np.where(of_jacobian, options.initial_variance, options.initial_hessian_variance)
        cells = self.shape if options.covariance == "full" else self.shape[:1]
        return np.broadcast_to(np.diag(variances), (*cells, columns, columns))

    def _record(self) -> None:
        options, kernels = self.options, self.kernels
        rows = (self.regressor, self.measured, self.gain)
        regressor, measured, gain = (seen_as(array, kernels.StateRow, array.shape[:1]) for array in rows)
        dq = seen_as(self.dq, kernels.JointVector, self.dq.shape[:1])
        assert options.prediction is not None  # the options have resolved it
        by_model = options.prediction in ("model", "nearest")
        or_flow = options.prediction == "nearest"
        iterations = options.prediction_iterations if by_model else {"flow": 1, "none": 0}[options.prediction]
        # One iteration moves a pixel by its own J dq alone, which the correction then finds itself.
        own_shift = options.covariance == "diagonal" and (not by_model or iterations == 1)
        limits = [options.rest, options.max_innovation or 0.0]
        spans = self.measured is not self.regressor
        moved_by = [self.model_flow if by_model else self.flow, iterations]
        flows = [self.flow, self.model_flow]
        noises = [options.process_noise, options.drift_noise, options.measurement_noise, options.max_variance]

        # On one thread: sooner done than shared out.
        self._count_bad = PixelLaunch(count_bad_flow, self.shape, [self.flow, self.bad], self.device)
        self.regress, self.update_gain, self.predict, self.correct = [], [], [], []
        for now in range(2):
            state, next_state = self.state[now], self.state[1 - now]
            covariance, next_covariance = self.covariance[now], self.covariance[1 - now]
            displacement, next_displacement = self.displacement[now], self.displacement[1 - now]
            rows = [self._regress(self.dq, displacement, self.regressor)]
            if spans:
                rows.append(self._regress(self.span, displacement, self.measured))
            by_row = not (self._once and options.covariance == "diagonal")
            self.regress.append(partial(_launch_all, rows if by_row else []))
            if not by_row:
                self.predict.append(_nothing)
                kernel = kernels.update_diagonal_once(by_model, iterations, options.move_variance)
                arguments = [state, covariance, self.flow, dq, *noises, next_state, next_covariance]
                self.correct.append(tile_launch(kernel, self.shape, arguments, self.device))
            elif self._once:
                self.predict.append(_nothing)  # the correction computes J dq where it wants it
                kernel = kernels.update_shared_once(by_model, iterations, or_flow, spans)
                arguments = [state, regressor, self.flow, measured, *limits, gain, next_state]
                self.correct.append(tile_launch(kernel, self.shape, arguments, self.device))
            elif own_shift:
                self.predict.append(_nothing)
            else:
                self.predict.append(self._pixels(kernels.predicted_flow, [state, regressor, self.model_flow]))
            if not self._once and options.covariance in ("shared", "fixed"):
                arguments = [state, *moved_by, int(or_flow), *limits, self.flow, self.model_flow]
                arguments += [regressor, measured, gain, next_state]
                self.correct.append(self._pixels(kernels.update_shared, arguments))
            if options.covariance == "shared":
                hessian = [options.hessian_noise, options.initial_hessian_variance]
                inputs = [self.dq, self.span, covariance, displacement, self.factor, *noises, *hessian]
                outputs = [self.projected, next_covariance, next_displacement, self.gain]
                self.update_gain.append(self._worlds(update_shared_covariance, [*inputs, *outputs]))
            elif options.covariance == "fixed":
                weights = [options.initial_variance, options.measurement_noise]
                self.update_gain.append(self._worlds(fixed_gain, [self.dq, *weights, self.gain]))
            else:
                self.update_gain.append(_nothing)  # each pixel has its own gain
            if not self._once and options.covariance == "diagonal":
                shift, finds_shift = moved_by[0], int(own_shift and by_model)
                inputs = [state, covariance, shift, finds_shift, iterations, int(options.move_variance), self.flow, dq]
                self.correct.append(
                    self._pixels(kernels.update_diagonal, [*inputs, *noises, next_state, next_covariance])
                )
            if options.covariance == "full":
                inputs = [state, covariance, *moved_by, *flows, dq, *noises]
                self.correct.append(self._pixels(kernels.update_full, [*inputs, next_state, next_covariance]))

    def _regress(self, span: wp.array, displacement: wp.array, row: wp.array) -> Callable[[], None]:
        return self._worlds(regressors, [self.dq, span, displacement, row], self.kernels.columns)

    def _pixels(self, kernel: Any, arguments: list[Any]) -> Callable[[], None]:
        return PixelLaunch(kernel, self.shape, arguments, self.device, self.threads)

    def _worlds(self, kernel: Any, arguments: list[Any], per_world: int | None = None) -> Callable[[], None]:
        dim = self.options.worlds if per_world is None else (self.options.worlds, per_world)
        return recorded(kernel, dim, arguments, self.device).launch


def filter_bytes(options: JacobianOptions) -> int:
    """Memory of a filter on a device for each world, about [bytes]."""
    columns = state_columns(options.joints, options.order or 1)
    own = {"diagonal": options.joints, "full": options.joints**2}.get(options.covariance, 0)
    # Both halves of state and covariance, flow and model flow; a float32 each.
    return 4 * options.height * options.width * (4 * columns + 2 * own + 4)


def _launch_all(launches: list[Callable[[], None]]) -> None:
    for launch in launches:
        launch()


def _nothing() -> None:
    pass
