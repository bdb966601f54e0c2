"""Watching a model while it is used: a buffer of observations, the norm of their gradients, and which camera moved.

The paper's Online Learning and Change-Point Detection. In a learned model the gradients of the buffer are nearly zero;
they spike when a camera moves. Beyond the paper, they are kept apart by camera and sample and set against what pixel
noise would give, so one sample already names the camera, and a threshold needs no tuning.

Small changes, as a part that slips in the hand or a lens that drifts, are followed by gradient steps on the buffer.
"""

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.generative.kinematics.placement import CAMERA_POINTS
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.report import FitReport

CHANGED = 4.0  # errors this many times the noise say that something changed
DRIFTED = 6.0  # gradients this many times what noise gives say that a part drifted; learning's own error makes 2 or so
FOLLOWED = "'structure' or 'camera:I'"
MEDIAN_OF_NOISE = 1.1774  # px of a distance per px of noise of a coordinate


class WatchedModel(Protocol):
    """The members of a :class:`GenerativeModel` that are used here."""

    parameters: ModelParameters
    report: FitReport
    image_sizes: list[tuple[int, int]]

    def pixels(self, joints: Any) -> np.ndarray:
        """Pixels ``(T, c, m, 2)`` at joints ``(T, n)``."""
        ...

    def relearn(self, obs: Observations, what: str, seed: int = 0) -> FitReport:
        """Relearn one part."""
        ...


@dataclass(frozen=True)
class Change:
    """Result of one observation.

    Attributes:
        gradient_norm: of the buffer's loss by all parameters, Gothoskar (6).
        camera_gradient_norms: ``(c,)`` the part by each camera's own parameters.
        camera_gradient_ratios: ``(c,)`` the same over what pixel noise gives: g^T (J^T J)^-1 g per unknown and pixel
            variance, about 1 in a model that holds.
        camera_errors_px: ``(c,)`` median error of the new sample by camera, NaN where nothing was seen.
        moved_cameras: those that the sample contradicts while others agree with the model.
        everything_moved: all cameras contradict it: the base, the hand's features or the joints changed.
    """

    gradient_norm: float
    camera_gradient_norms: np.ndarray
    camera_gradient_ratios: np.ndarray
    camera_errors_px: np.ndarray
    moved_cameras: tuple[int, ...]
    everything_moved: bool


class OnlineLearner:
    """A buffer of the latest observations of a model in use; made by :meth:`GenerativeModel.online`.

    Args:
        model: is changed by :meth:`relearn`.
        capacity: observations that the buffer holds.
        relearn_after: samples of a moved camera that :meth:`add` collects before it relearns it, those in which it sees
            enough to place it by; 0 for never.
    """

    def __init__(self, model: WatchedModel, capacity: int = 50, relearn_after: int = 0):
        capacity = check_whole("capacity", capacity, least=1, most=10**6)
        self.model, self.relearn_after = model, check_whole("relearn_after", relearn_after, least=0)
        self.buffer: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=capacity)
        self.ignored: set[int] = set()
        self._since: dict[int, int] = {}

    def add(self, joints: Any, pixels: Any) -> Change:
        """Take one observation: joints ``(n,)`` [rad] and pixels ``(c, m, 2)``.

        A moved camera is ignored from then on, in :attr:`ignored`, until it was relearned.

        Raises:
            DenseVSError: shapes that do not fit the model.
        """
        p = self.model.parameters
        q, x = number_array(joints, "joints", finite=False), number_array(pixels, "pixels", finite=False)
        expected = (len(p.intrinsics), len(p.features), 2)
        if q.shape != (p.joint_count,) or x.shape != expected or not np.isfinite(q).all():
            raise DenseVSError(
                f"joints and pixels have shapes {q.shape}, {x.shape}; expected finite ({p.joint_count},) and {expected}"
            )
        self.buffer.append((q, x))
        errors = np.linalg.norm(self.model.pixels(q[None])[0] - x, axis=2)
        medians = np.array([np.median(e[np.isfinite(e)]) if np.isfinite(e).any() else np.nan for e in errors])
        limit = CHANGED * MEDIAN_OF_NOISE * max(self._expected_sigma(), 0.3)
        contradicts = np.nan_to_num(medians) > limit
        agrees = medians <= limit
        everything = bool(contradicts.any() and not agrees.any() and len(medians) > 1)
        moved = () if everything else tuple(int(c) for c in np.flatnonzero(contradicts))
        for camera in {*moved, *self.ignored}:
            self.ignored.add(camera)
            self._since[camera] = self._since.get(camera, 0) + 1
        for camera in sorted(self.ignored):
            if self.relearn_after and self._useful(camera) >= self.relearn_after:
                self.relearn(camera)
        norms, ratios = self.gradient_norms()
        return Change(float(np.linalg.norm(norms)), norms[: len(medians)], ratios, medians, moved, everything)

    def gradient_norms(self) -> tuple[np.ndarray, np.ndarray]:
        """Norms of the gradient of the buffer's loss: by each camera's parameters, then by all others, ``(c + 1,)``.

        Beside them the cameras' ratios ``(c,)``, as in :class:`Change`.
        """
        known = finite_rows(self.model.parameters.features)
        problem, state = self._problem(Free(kinematics=True, features=known, cameras=True, intrinsics=True))
        equations = problem.linearize(state)
        gradient, variance = 2 * equations.shared_gradient, self._pixel_sigma() ** 2
        columns, norms, ratios, rest = problem.columns, [], [], np.ones(len(gradient), dtype=bool)
        for pose, inner in zip(columns.cameras, columns.intrinsics, strict=True):
            own = [*range(pose, pose + 6), *range(inner, inner + columns.intrinsics_count)]
            norms.append(np.linalg.norm(gradient[own]))
            half = gradient[own] / 2
            step = np.linalg.lstsq(equations.shared[np.ix_(own, own)], half, rcond=1e-12)[0]
            ratios.append(half @ step / (variance * len(own)))
            rest[own] = False
        return np.array([*norms, np.linalg.norm(gradient[rest])]), np.array(ratios)

    def follow(self, what: str, rate: float = 0.5) -> float:
        """Move a part a step down the gradient of the buffer's loss, where that is larger than noise makes it.

        The paper's online learning, with its threshold on the gradients. Beyond the paper, the step is scaled by the
        inverse of J^T J, so that no step size depends on units. Call it after :meth:`add`. A buffer of few samples
        follows faster, one of many more smoothly.

        Args:
            what: ``"structure"``, the features, or ``"camera:I"``, the pose and lens of one camera.
            rate: share of the whole step, above 0 and at most 1.

        Returns:
            The gradient over what pixel noise gives, as in :class:`Change`; above :data:`DRIFTED` the step was made.

        Raises:
            DenseVSError: another part or rate, an empty buffer, or a camera that :attr:`ignored` holds.
        """
        rate = check_number("rate", rate, above=0.0, most=1.0)
        problem, state = self._problem(self._drifting(what), self.ignored)
        equations = problem.linearize(state)
        gradient = equations.shared_gradient
        step = np.linalg.lstsq(equations.shared, gradient, rcond=1e-9)[0]
        held = np.count_nonzero(equations.shared.diagonal())
        ratio = float(gradient @ step) / (self._expected_sigma() ** 2 * max(held, 1))
        if ratio > DRIFTED:
            moved = problem.move(state, -rate * step).parameters
            moved.features[~finite_rows(self.model.parameters.features)] = np.nan
            if problem.cost(PixelState(moved, state.joints)) < equations.cost:
                self.model.parameters = moved
        return ratio

    def _drifting(self, what: str) -> Free:
        """The unknowns of a part that :meth:`follow` names."""
        count = len(self.model.parameters.intrinsics)
        camera = what.removeprefix("camera:") if isinstance(what, str) else ""
        if not self.buffer:
            raise DenseVSError("the buffer is empty; expected observations to follow, by add()")
        if what == "structure":
            return Free(features=finite_rows(self.model.parameters.features))
        if camera == what or not camera.isdecimal() or int(camera) >= count:
            raise DenseVSError(f"what is {what!r}; expected {FOLLOWED}, I below {count}")
        if int(camera) in self.ignored:
            raise DenseVSError(f"camera {camera} has moved and is ignored; relearn it: gradients follow small changes")
        chosen = np.arange(count) == int(camera)
        return Free(cameras=chosen, intrinsics=chosen)

    def _problem(self, free: Free, without: Collection[int] = ()) -> tuple[PixelProblem, PixelState]:
        """The buffer's loss, Gothoskar (6), by some unknowns, without some cameras, and where the model stands."""
        p = self.model.parameters
        joints = np.array([q for q, _ in self.buffer])
        pixels = np.where(finite_rows(p.features)[:, None], np.array([x for _, x in self.buffer]), np.nan)
        pixels[:, sorted(without)] = np.nan
        problem = PixelProblem(pixels, p.links, p.joint_count, free)
        finite = p.copy()
        finite.features = np.nan_to_num(finite.features)
        state = PixelState(finite, joints)
        behind = problem.seen & ~np.isfinite(problem.pixel_errors(state))
        problem.reweight(np.where(behind, 0.0, 1.0))
        return problem, state

    def _useful(self, camera: int) -> int:
        """Samples since it moved in which a camera sees enough of the model's features to be placed by."""
        known = finite_rows(self.model.parameters.features)
        latest = list(self.buffer)[-self._since[camera] :]
        return sum(np.isfinite(x[camera, known, 0]).sum() >= CAMERA_POINTS for _, x in latest)

    def _pixel_sigma(self) -> float:
        return max(self.model.report.pixel_sigma or 0.5, 0.05)

    def _expected_sigma(self) -> float:
        """Error of a coordinate [px] that readings bring: with noisy joints more than the pixels'."""
        if self.model.report.joint_sigma is None:
            return self._pixel_sigma()
        before = [stage.rms for stage in self.model.report.stages if stage.name == "end to end"]
        return max([self._pixel_sigma(), *before])

    def relearn(self, camera: int) -> None:
        """Relearn a moved camera from the samples since it moved, and use it again.

        Raises:
            DenseVSError: the camera did not move, or its samples do not suffice.
        """
        count = self._since.get(camera, 0)
        if count == 0:
            raise DenseVSError(f"camera {camera} has not moved; those that have: {sorted(self._since)}")
        latest = list(self.buffer)[-count:]
        h, w = self.model.image_sizes[camera]
        obs = Observations(
            joints=np.array([q for q, _ in latest]),
            pixels=np.array([x for _, x in latest]),
            image_sizes=self.model.image_sizes or [(h, w)],
            feature_link=self.model.parameters.links,
        )
        self.model.relearn(obs, f"camera:{camera}")
        self.ignored.discard(camera)
        del self._since[camera]
