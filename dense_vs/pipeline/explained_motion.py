"""How much of the image motion J explains one frame ahead: quality without a truth.

E = 1 - sum |u - J dq|^2 / sum |u|^2 over pixels that move by more than 0.7 px, with J as it was before the frame, moved
along with its own prediction DIJE (14). 1 is all of the motion, 0 is none; less than 0 is worse than no J. A joint's
part is the mean of (2 u - J dq) . J_n dq_n over |u|^2; the parts add up to E. Beyond the paper, which has a simulator's
truth or none.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dense_vs.arrays import number_array, plain_array
from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian

MOVING = 0.7  # px a frame
KNOWN = 0.1  # px a frame
POINTS_ACROSS = 160  # columns of the grid of pixels that are looked at
MOST_SPANS = 4096  # kept over time, so that memory does not grow with length


@dataclass(frozen=True)
class MotionSums:
    """Sums over a span of time.

    Attributes:
        time: of its last frame [s].
        energy: sum of |u|^2 [px^2].
        parts: ``(N,)`` what each joint explains of it [px^2].
    """

    time: float
    energy: float
    parts: np.ndarray


class ExplainedMotion:
    """Gathers E over a recording.

    Args:
        joints: number of joints N.

    Raises:
        DenseVSError: fewer than one.
    """

    def __init__(self, joints: int):
        self.joints = check_whole("joints", joints, least=1)
        self.spans: list[MotionSums] = []
        self._frames_in_span, self._waiting = 1, []

    @np.errstate(over="ignore", invalid="ignore")  # what is not finite then is refused
    def observe(self, time: float, flow: np.ndarray, jacobian: np.ndarray, dq: np.ndarray) -> None:
        """Compare a flow ``(H, W, 2)`` [px] with J ``(H, W, 2, N)`` before the frame and the joint step ``(N,)``.

        Raises:
            DenseVSError: arrays that are no such numbers, or a time that is not finite. NaN of J or of the step counts
                as 0, a pixel whose flow is not finite is left out, and infinities of J or the step are refused.
        """
        time = check_number("time", time)
        step = np.nan_to_num(number_array(dq, "dq", (self.joints,), finite=False), posinf=np.inf, neginf=-np.inf)
        flow = _check_image("flow", flow, (-1, -1, 2))
        height, width = flow.shape[:2]
        jacobian = _check_image("jacobian", jacobian, (height, width, 2, self.joints))
        stride = max(1, round(width / POINTS_ACROSS))
        rows, columns = np.mgrid[0:height:stride, 0:width:stride]
        u = flow[rows, columns].astype(np.float64)
        moving = np.isfinite(u).all(axis=2) & (np.linalg.norm(np.nan_to_num(u), axis=2) > MOVING)
        rows, columns, u = rows[moving], columns[moving], u[moving]
        row, column = rows, columns
        J = np.zeros((len(rows), 2, self.joints))
        for _ in range(3):  # the place that came here: y = x - J(y) dq
            J = np.nan_to_num(jacobian[row, column].astype(np.float64), posinf=np.inf, neginf=-np.inf)
            predicted = J @ step
            _check_finite(predicted)
            column = np.clip(np.rint(columns - predicted[:, 0]), 0, width - 1).astype(int)
            row = np.clip(np.rint(rows - predicted[:, 1]), 0, height - 1).astype(int)
        predicted = J @ step
        parts = np.einsum("pc,pcn->n", 2 * u - predicted, J) * step
        energy = float(np.sum(u * u))
        _check_finite(np.append(parts, energy))
        self._add(MotionSums(time, energy, parts))

    def explained(self, begin: float = -np.inf, end: float = np.inf) -> float:
        """E of the frames with ``begin < time <= end``; NaN where nothing moved.

        Raises:
            DenseVSError: a begin or end that is no number.
        """
        return float(np.sum(self.by_joint(begin, end)))

    def by_joint(self, begin: float = -np.inf, end: float = np.inf) -> np.ndarray:
        """Each joint's part of E, ``(N,)``; NaN where nothing moved.

        Raises:
            DenseVSError: a begin or end that is no number.
        """
        first, last = (number_array(t, name, (), finite=False) for name, t in (("begin", begin), ("end", end)))
        chosen = [span for span in self._all() if first < span.time <= last]
        energy = sum(span.energy for span in chosen)
        if not energy:
            return np.full(self.joints, np.nan)
        return np.sum([span.parts for span in chosen], axis=0) / energy

    def quarters(self) -> list[float]:
        """E of each quarter of the time."""
        spans = self._all()
        if not spans:
            return [float("nan")] * 4
        edges = np.linspace(self._begin, spans[-1].time, 5)
        edges[0] = -np.inf
        return [self.explained(a, b) for a, b in pairwise(edges)]

    def settled(self) -> float:
        """E after the first quarter of the time."""
        spans = self._all()
        return self.explained(self._begin + 0.25 * (spans[-1].time - self._begin)) if spans else float("nan")

    def over_time(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (M,) [s] and E (M,) of the spans in which something moved."""
        spans = [span for span in self._all() if span.energy > 0]
        return np.array([s.time for s in spans]), np.array([s.parts.sum() / s.energy for s in spans])

    def _add(self, sums: MotionSums) -> None:
        if not self.spans and not self._waiting:
            self._begin = sums.time
        self._waiting.append(sums)
        if len(self._waiting) < self._frames_in_span:
            return
        self.spans.append(_joined(self._waiting))
        self._waiting = []
        if len(self.spans) >= MOST_SPANS:
            self.spans = [_joined(self.spans[k : k + 2]) for k in range(0, len(self.spans), 2)]
            self._frames_in_span *= 2

    def _all(self) -> list[MotionSums]:
        return [*self.spans, _joined(self._waiting)] if self._waiting else self.spans


def _check_image(name: str, image: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The image, if it is floating-point numbers of a shape, in which -1 takes any length but 0."""
    if isinstance(image, np.ndarray):
        image = plain_array(image, name, "floating-point numbers")
    sizes = image.shape if isinstance(image, np.ndarray) and image.dtype.kind == "f" and image.size else ()
    if len(sizes) != len(shape) or any(want not in (-1, got) for want, got in zip(shape, sizes, strict=True)):
        got = f"has shape {image.shape} and dtype {image.dtype}" if isinstance(image, np.ndarray) else "is no array"
        expected = str(tuple("any" if n < 0 else n for n in shape)).replace("'", "")
        raise DenseVSError(f"{name} {got}; expected floating-point numbers of shape {expected}")
    return image


def _check_finite(numbers: np.ndarray) -> None:
    if not np.isfinite(numbers).all():
        raise DenseVSError("flow, jacobian or dq make a motion that is not finite; expected finite ones, NaN aside")


def _joined(spans: list[MotionSums]) -> MotionSums:
    energy = sum(span.energy for span in spans)
    return MotionSums(spans[-1].time, energy, np.sum([span.parts for span in spans], axis=0))


def share_of_pixels_known(estimator: DenseJacobian, usual_step: np.ndarray) -> float:
    """Share of the pixels that usual joint steps ``(N,)``, each by itself, would move by more than 0.1 px."""
    J = np.nan_to_num(estimator.to_numpy())
    moved = np.linalg.norm(J * usual_step, axis=2).max(axis=2)
    return float(np.mean(moved > KNOWN))
