"""J's prior from a body that is known: where the model has the body, J is drawn to the model's, as long as they agree.

A model that was learned before knows J on plain surfaces, on what has just been uncovered and at the first image, where
flow tells little or nothing (beyond DIJE, which starts from zero). A bumped camera or a tool in the hand makes it
wrong: the share of the image motion that it explains is watched, and below a bound it has no say.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import cv2
import numpy as np

from dense_vs.arrays import plain_array, real_vector
from dense_vs.body.guided_filter import guided_filter
from dense_vs.checks import check_function, check_methods, check_number, check_pair, check_whole, shown
from dense_vs.device import one_blas_thread
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.kernels.jacobian.present_state import PresentState
from dense_vs.pipeline.occlusion import Occlusion
from dense_vs.pipeline.unexplained_share import UnexplainedShare
from dense_vs.pipeline.vacated import Vacated

LARGEST_SIDE = 1 << 14  # px
MEMORY = 0.9  # of the agreement, from one measured motion to the next
EDGE_RADIUS, FLATNESS = 6, 1e-3  # of the smoothing by which the model's outline goes to the image's edges
LABELED = 0.7  # share of the body around a pixel by then: the model's outline lies outside rather than inside
BESIDE = 3  # px about the model's body in which what was seen counts: flow takes what is beside the robot along with it
HIDDEN_SHARE = 0.5  # at least, by which J is drawn to the model's where something covers the body
# At every measured motion: of a chain, found on simulated arms, and of J remembered by posture, found on three reaches
# of a humanoid. What is remembered is coarser than what is measured now, so it has less say, but keeps it as long as it
# explains anything.
CHAIN_SHARE, CHAIN_AGREEMENT = 0.7, 0.5
MEMORY_SHARE, MEMORY_AGREEMENT = 0.2, 0.0


class KnownBody(Protocol):
    """What :class:`BodyModel` and :class:`PostureMemory` have in common."""

    size: tuple[int, int]

    @property
    def joint_count(self) -> int:
        """N."""
        ...

    def known(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J ``(H, W, 2, N)`` [px/rad] and the body's pixels ``(H, W)`` at a posture."""
        ...


class BodyPrior:
    """Draws an estimator's J to that of a model.

    Args:
        known: gives J ``(H, W, 2, N)`` [px/rad] and a mask of the body ``(H, W)`` at a posture ``(N,)``, as
            ``BodyModel.known`` does.
        share: by which J is drawn at every measured motion; with 1 it is the model's wherever that has the body.
        least_agreement: below it the model has no say.
        told: gives ``(N, N)`` at a posture ``(N,)``, which joint steps the model's J speaks of, as
            ``PostureMemory.told`` does; of all unless given. In other directions J stays as it is.
        corrected: gives the model's J ``(H, W, 2, N)`` at a posture ``(N,)``, its depths corrected by the estimator's
            J, as ``BodyModel.corrected_jacobian`` does; that is what J is drawn to, where given.
        moved: gives the motion by the model's J ``(H, W, 2)`` [px] at a posture by a joint step ``(N,)``, and the mask
            of the body, as ``BodyModel.moved`` does; asked in place of ``known``, where given.
        blended: draws an estimator's state on a CPU to what ``corrected`` gives, at a posture by a share, as
            ``BodyModel.blend`` does; asked in its place, where given.

    Attributes:
        agreement: share of the image motion on the body that the model explained lately; 1 is all, 0 none, and below,
            as J remembered by posture can be, is worse than no model.

    Raises:
        DenseVSError: what is no function, a share out of (0, 1], or an agreement above 1.
    """

    def __init__(
        self,
        known: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
        *,
        share: float = 1.0,
        least_agreement: float = 0.5,
        told: Callable[[np.ndarray], np.ndarray] | None = None,
        corrected: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
        moved: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None,
        blended: Callable[[np.ndarray, PresentState, np.ndarray], None] | None = None,
    ):
        if not callable(known):
            raise DenseVSError(f"known is {shown(known)}; expected a function of joint positions")
        check_function("told", told)
        check_function("corrected", corrected)
        check_function("moved", moved)
        check_function("blended", blended)
        self.known, self.told, self.corrected, self.moved, self.blended = known, told, corrected, moved, blended
        self.share = check_number("share", share, above=0, most=1)
        self.least_agreement = check_number("least_agreement", least_agreement, most=1)
        self.agreement = 1.0
        self._occlusion: Occlusion | None = None
        self._vacated: Vacated | None = None
        self._unexplained: UnexplainedShare | None = None
        self._left: np.ndarray | None = None  # by the last motion, where J stays behind
        self._kept: tuple[bytes, np.ndarray, np.ndarray] | None = None  # posture, J and body asked for last
        self._motion: tuple[bytes, bytes, np.ndarray, np.ndarray] | None = None  # posture, step, motion and body

    @classmethod
    def of(cls, body: KnownBody, size: tuple[int, int], joints: int) -> "BodyPrior":
        """The prior of a saved body, in images of any scale.

        Args:
            body: a body model, or J remembered by posture.
            size: (height, width) of the estimator's images [px].
            joints: of the estimator.

        Raises:
            DenseVSError: no body, another number of joints, or images of another shape.
        """
        check_methods("body", body, "known")
        lacking = [member for member in ("size", "joint_count") if not hasattr(body, member)]
        if lacking:
            raise DenseVSError(f"body is a {type(body).__name__} without {', '.join(lacking)}; expected a known body")
        size = check_pair("size", size, least=1, most=LARGEST_SIDE)
        joints = check_whole("joints", joints, least=1, most=4096)
        if joints != body.joint_count or abs(size[1] / body.size[1] * body.size[0] - size[0]) > 1:
            raise DenseVSError(
                f"the body is of {body.size[1]} x {body.size[0]} px and {body.joint_count} joints; expected "
                f"{size[1]} x {size[0]} px, or another scale of it, and {joints} joints"
            )

        def known(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            J, mask = body.known(q)
            return _resized(J, size), _resized_mask(mask, size)

        names = "told", "corrected_jacobian", "moved", "blend"
        told, by_depth, step_of, blend = (getattr(body, name, None) for name in names)

        def corrected(q: np.ndarray, measured: np.ndarray) -> np.ndarray:
            assert by_depth is not None  # else nobody asks
            return _resized(by_depth(q, _resized(measured, body.size)), size)

        def moved(q: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            assert step_of is not None
            motion, mask = step_of(q, step)
            return _resized(motion, size), _resized_mask(mask, size)

        if told is None:
            of_body = {"corrected": by_depth and corrected, "moved": step_of and moved}
            of_body |= {"blended": blend if size == tuple(body.size) else None}
            return cls(known, share=CHAIN_SHARE, least_agreement=CHAIN_AGREEMENT, **of_body)
        return cls(known, share=MEMORY_SHARE, least_agreement=MEMORY_AGREEMENT, told=told)

    @property
    def agrees(self) -> bool:
        """Whether the model has a say."""
        return self.agreement >= self.least_agreement

    def begin(self, estimator: DenseJacobian, positions: Any, share: float = 1.0) -> None:
        """Start from the model's J at a posture ``(N,)`` [rad], or draw what is there to it by a share.

        Raises:
            DenseVSError: no estimator, positions that are not finite numbers, or a share out of 0 to 1.
        """
        positions = _posture(estimator, positions)
        share = check_number("share", share, least=0, most=1)
        body = self._body(positions)
        self._blend(estimator, positions, np.float32(share) * body.astype(np.float32))

    @property
    def hidden(self) -> np.ndarray | None:
        """Bool ``(H, W)``, pixels of the body that something else covers; None where that is not known."""
        return None if self._occlusion is None else self._occlusion.hidden

    @property
    def doubtful(self) -> bool:
        """Whether nearly all of the body seemed covered by the last motion: rather, this was not the joints'."""
        return self._occlusion is not None and self._occlusion.doubtful

    def labels(self, own: Any, positions: Any, image: Any) -> np.ndarray:
        """Labels ``(H, W)`` of the body: what was seen, what the model has to the image's edges, and what is hidden.

        Motion says little of plain surfaces, which the model knows from where their edges were seen. What was seen
        counts on the model's body and up to :data:`BESIDE` px beside it, where its outline may be off.

        Args:
            own: bool ``(H, W)``, labels by what was seen.
            positions: ``(N,)`` [rad].
            image: RGB uint8 ``(H, W, 3)`` or gray ``(H, W)``.

        Raises:
            DenseVSError: labels, positions or an image of another kind or size.
        """
        positions = real_vector(positions, "positions", (-1,))
        own = plain_array(own, "own", "bool of shape (H, W)")
        if own.dtype != bool or own.ndim != 2:
            raise DenseVSError(f"own has shape {own.shape} and dtype {own.dtype}; expected bool of shape (H, W)")
        image = plain_array(image, "image", "uint8 of own's shape")
        if image.dtype != np.uint8 or image.shape not in (own.shape, (*own.shape, 3)):
            raise DenseVSError(
                f"image has shape {image.shape} and dtype {image.dtype}; expected uint8 of shape {own.shape}, "
                "or with 3 colors"
            )
        if self.told is not None or not self.agrees:
            return own
        body = self._body(positions)
        if body.shape != own.shape:
            raise DenseVSError(f"own has shape {own.shape}; expected the body's, {body.shape}")
        smooth = guided_filter(image, body.astype(np.float32), EDGE_RADIUS, FLATNESS)
        near = cv2.dilate(body.astype(np.uint8), np.ones((2 * BESIDE + 1,) * 2, np.uint8)) > 0
        labels = (own & near) | (smooth > LABELED)
        if self._occlusion is not None:
            labels = np.where(self._occlusion.lately, body, labels)
        return labels

    def uncovered(self, estimator: DenseJacobian, positions: Any, flow: Any, span: Any) -> np.ndarray:
        """A measured flow without what covers the body, NaN there, so that J is not unlearned; as it is for no outline.

        Args:
            estimator: before its update by this flow.
            positions, flow, span: as in :meth:`correct`.

        Raises:
            DenseVSError: as :meth:`correct`.
        """
        positions, flow = _posture(estimator, positions), _flow(flow)
        step = _step(span, positions)
        if self.told is not None or not self.agrees:
            self._occlusion = self._vacated = self._left = None
            return flow
        by_model, body = self._moved_by(positions, step)
        _flow(flow, body.shape)
        if self._occlusion is None:
            self._occlusion, self._vacated = Occlusion(body.shape), Vacated(body.shape)
        assert self._vacated is not None  # it comes and goes with the other
        by_estimate = estimator.predicted_flow(step)
        self._left = self._vacated.observe(body, flow, by_estimate)
        hidden = self._occlusion.observe(body, flow, by_model, by_estimate)
        if not hidden.any():
            return flow
        told = np.array(flow, np.float32)
        both = told.view(np.complex64)[..., 0]  # x and y as one number: by a mask of pixels ten times as fast
        both[self._occlusion.around] = complex(np.nan, np.nan)
        return told

    @np.errstate(over="ignore", invalid="ignore")  # a motion that float32 does not hold counts for nothing
    def correct(self, estimator: DenseJacobian, positions: Any, flow: Any, span: Any) -> None:
        """After a measured motion: judge the model by it, and draw J to the model's if it agrees.

        Args:
            estimator: after its update.
            positions: ``(N,)`` [rad].
            flow: ``(H, W, 2)`` [px] that was measured; what is not finite does not count.
            span: ``(N,)`` joint displacement of that flow [rad].

        Raises:
            DenseVSError: no estimator, other shapes, or joints that are not finite; nothing has changed then.
        """
        positions = _posture(estimator, positions)
        step = _step(span, positions)
        by_model, body = self._moved_by(positions, step)
        flow = _flow(flow, body.shape)
        if self._unexplained is None:
            self._unexplained = UnexplainedShare(body.shape, of_chain=self.told is None)
        unexplained = self._unexplained(body, flow, by_model)
        if unexplained is not None:
            self.agreement = MEMORY * self.agreement + (1 - MEMORY) * (1 - unexplained)
        self._draw(estimator, positions, self._left)

    def draw(self, estimator: DenseJacobian, positions: Any) -> None:
        """Draw J to the model's at a posture ``(N,)`` [rad], if they agree; more where something covers the body.

        Raises:
            DenseVSError: no estimator, or positions that are not finite numbers.
        """
        self._draw(estimator, _posture(estimator, positions), None)

    def _draw(self, estimator: DenseJacobian, positions: np.ndarray, left: np.ndarray | None) -> None:
        """As :meth:`draw`; to 0 on what the body has left, bool ``(H, W)``."""
        if not self.agrees:
            return
        body = self._body(positions)
        share = self.share * body.astype(np.float32)
        if self.hidden is not None:
            share[self.hidden & body] = max(self.share, HIDDEN_SHARE)
        if left is not None:
            share[left] = self.share
        self._blend(estimator, positions, share)

    def _at(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the model knows at a posture, which is asked for several times."""
        posture = positions.tobytes()
        if self._kept is None or self._kept[0] != posture:
            self._kept = posture, *self.known(positions)
        return self._kept[1:]

    def _body(self, positions: np.ndarray) -> np.ndarray:
        """Where the model has the body at a posture."""
        if self._motion is not None and self._motion[0] == positions.tobytes():
            return self._motion[3]
        return self._at(positions)[1]

    def _blend(self, estimator: DenseJacobian, positions: np.ndarray, share: np.ndarray) -> None:
        """Draw J to the model's at a posture by shares ``(H, W)``."""
        if self.blended is not None and estimator.device.is_cpu:
            estimator.blend(partial(self.blended, positions), share)
        else:
            estimator.blend(self._completed(estimator, positions), share)

    def _completed(self, estimator: DenseJacobian, positions: np.ndarray) -> np.ndarray:
        """The model's J, with the estimator's in what the model does not speak of or knows less well."""
        if self.corrected is not None:
            return self.corrected(positions, estimator.to_numpy())
        J = self._at(positions)[0]
        if self.told is None:
            return J
        told = np.asarray(self.told(positions), dtype=np.float32)
        return J + estimator.to_numpy() @ (np.eye(len(told), dtype=np.float32) - told)

    def _moved_by(self, positions: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What moves by the model at a posture by a joint step, and the body; asked for twice a motion."""
        asked = positions.tobytes(), step.tobytes()
        if self._motion is None or self._motion[:2] != asked:
            if self.moved is not None:
                self._motion = *asked, *self.moved(positions, step)
            else:
                J, body = self._at(positions)
                with one_blas_thread():
                    self._motion = *asked, (J.reshape(-1, len(step)) @ step).reshape(J.shape[:3]), body
        return self._motion[2:]


def _resized(J: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """J ``(H, W, 2, N)``, or a motion ``(H, W, 2)``, in images of another scale."""
    if J.shape[:2] == size:
        return J
    flat = np.ascontiguousarray(J.reshape(*J.shape[:2], -1))
    resized = cv2.resize(flat, size[::-1], interpolation=cv2.INTER_LINEAR) * np.float32(size[1] / J.shape[1])
    return resized.reshape(*size, *J.shape[2:])


def _resized_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    if mask.shape == size:
        return mask
    return cv2.resize(mask.astype(np.uint8), size[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)


def _posture(estimator: Any, positions: Any) -> np.ndarray:
    """Positions as float64, of an estimator that J can be blended into."""
    check_methods("estimator", estimator, "blend")
    return real_vector(positions, "positions", (-1,))


def _step(span: Any, positions: np.ndarray) -> np.ndarray:
    return real_vector(span, "span", positions.shape, np.float32)


def _flow(flow: Any, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """A flow ``(H, W, 2)``, of a size where that is known."""
    expected = f"floating point of shape {'(H, W, 2)' if shape is None else (*shape, 2)}"
    array = plain_array(flow, "flow", expected)
    fits = array.shape[-1:] == (2,) and array.ndim == 3 if shape is None else array.shape == (*shape, 2)
    if array.dtype.kind != "f" or not fits:
        raise DenseVSError(f"flow has shape {array.shape} and dtype {array.dtype}; expected {expected}")
    return array
