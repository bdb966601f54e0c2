"""Offset between the camera's clock and the joints' in a recording, with its confidence and its drift over minutes.

The offset that is added to the joints' times is the negative of their delay, found from the motion that camera and
joints have both seen as in :mod:`dense_vs.recording.joint_delay`. A recording is longer than the second or two over
which J is nearly constant: it is cut into windows, each with a J of its own, whose unexplained motion is summed.

Confidence: the windows are drawn anew 200 times with replacement, and the answer found for each draw. The confidence
is the share of these answers within 1/30 s of the one for all windows; their spread (half the central 68 %) is the
standard error. Windows overlap by half, so each draw takes half as many.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from dense_vs.checks import check_number, check_seed
from dense_vs.errors import DenseVSError
from dense_vs.recording.joint_delay import DelayCurve, even_joints, joint_steps, unexplained_by_constant_jacobian
from dense_vs.recording.joint_log import JointLog
from dense_vs.robot.camera_image import check_gray

REACH = 0.4  # s; offsets of +-0.3 s and room for the lowest point around them
DELAY_STEP = 0.01  # s between the delays tried
WINDOW = 1.6  # s
LEAST_PAIRS = 8  # image pairs in a window
LEAST_MOTION = 0.02  # px a pair at 160 px width, root mean square: below it there is no motion to compare
DRAWS = 200
# What an offset must reach to be used. Of 30 pairs of real images with the reversed joints of another episode none did.
ENOUGH = 0.6  # confidence
MOST_ERROR = 0.04  # s
ONE_IMAGE = 1 / 30  # s
LEAST_DRIFT_SECONDS = 60.0  # a clock's drift shows over minutes
MOST_PAIRS = 9000  # kept, ten minutes at 15 images a second


@dataclass(frozen=True)
class ClockOffset:
    """Offset that brings the joint log's times onto the camera's clock.

    Attributes:
        seconds: at the middle of the recording [s]; 0 where the motion does not tell.
        confidence: 0 to 1, see the module.
        error: standard error of ``seconds`` [s]; NaN where there was nothing to compare.
        drift: change of the offset a second [s/s]; 0 where none was found.
        middle: time on the camera's clock that ``seconds`` is for [s].
        best: the offset that explains the motion best, also where it is not certain enough to be used [s].
        reason: why ``seconds`` is 0 where it was not found, else empty.
    """

    seconds: float
    confidence: float
    error: float
    drift: float = 0.0
    middle: float = 0.0
    best: float = 0.0
    reason: str = ""

    def applied(self, log: JointLog) -> JointLog:
        """The log on the camera's clock.

        Raises:
            DenseVSError: no log, or an offset that is not finite.
        """
        _check_log(log)
        for name in ("seconds", "drift", "middle"):
            check_number(name, getattr(self, name))
        times = log.times + self.seconds
        return JointLog(log.names, times + self.drift * (times - self.middle), log.positions)


@dataclass
class MotionSamples:
    """Coarse flow of image pairs, gathered while a recording is read; memory is bounded.

    Attributes:
        pairs: times of both images of each pair [s].
        flows: their flow, means of blocks of 8 x 8 px at 160 px width, flattened [px].
    """

    pairs: list[tuple[float, float]] = field(default_factory=list)
    flows: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self):
        self._flow: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._last: tuple[np.ndarray, float] | None = None

    def add(self, gray: np.ndarray, time: float) -> None:
        """Take the next image that is no repetition, gray uint8 ``(H, W)``, and its stamp [s].

        Raises:
            DenseVSError: no such image, one of other proportions than the last, or a stamp that is not finite.
        """
        gray = check_gray(gray)
        height, width = gray.shape
        time = check_number("image time stamp", time)
        size = 160, max(16, round(height * 160 / width))
        if self._last is not None and self._last[0].shape != size[::-1]:
            raise DenseVSError(
                f"image has shape {gray.shape}, other proportions than the last; expected one camera's, or restart()"
            )
        small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        if self._last is not None and len(self.pairs) < MOST_PAIRS:
            before, then = self._last
            # From the present image to the one before, as everywhere; its sign does not matter here.
            flow = self._flow.calc(small, before, None)
            blocks = cv2.resize(flow, (size[0] // 8, size[1] // 8), interpolation=cv2.INTER_AREA)
            self.pairs.append((then, time))
            self.flows.append(blocks.ravel())
        self._last = small, time

    def restart(self) -> None:
        """Forget the last image, after a gap."""
        self._last = None


def find_clock_offset(samples: MotionSamples, log: JointLog, *, seed: int = 0) -> ClockOffset:
    """The offset of a joint log, see the module.

    Args:
        samples: the images' motion.
        log: the joints to compare it with, on their own clock.
        seed: of the draws that give the confidence.

    Raises:
        DenseVSError: no such samples, log or seed.
    """
    if not isinstance(samples, MotionSamples):
        raise DenseVSError(f"samples are a {type(samples).__name__}; expected MotionSamples")
    _check_log(log)
    seed = check_seed(seed)
    times, joints = even_joints(log.times, log.positions)
    delays = np.arange(-round(REACH / DELAY_STEP), round(REACH / DELAY_STEP) + 1) * DELAY_STEP
    pairs, flows = np.array(samples.pairs).reshape(-1, 2), samples.flows
    inside = np.flatnonzero((pairs[:, 0] >= times[0] - REACH) & (pairs[:, 1] <= times[-1] + REACH))
    if joints.shape[1] == 0:
        return _unknown("no joint moves")
    if inside.size < LEAST_PAIRS:
        return _unknown(f"fewer than {LEAST_PAIRS} images with motion within the joint log")
    pairs, motion = pairs[inside], np.stack([flows[k] for k in inside])
    if np.sqrt(np.mean(motion**2, axis=1)).max() < LEAST_MOTION:
        return _unknown("nothing moves in the images")
    curves, middles = _window_curves(pairs, motion, times, joints, delays)
    if not len(curves) or np.ptp(curves.sum(axis=0)) == 0:
        return _unknown("no second and a half with both image and joint motion")
    best = DelayCurve(delays, curves.sum(axis=0)).best
    random = np.random.default_rng(seed)
    draws = [random.integers(0, len(curves), max(len(curves) // 2, 2)) for _ in range(DRAWS)]
    found = np.array([DelayCurve(delays, curves[chosen].sum(axis=0)).best for chosen in draws])
    confidence = float(np.mean(np.abs(found - best) < ONE_IMAGE))
    error = float(np.quantile(found, 0.84) - np.quantile(found, 0.16)) / 2
    if confidence < ENOUGH or error > MOST_ERROR or abs(best) > REACH - DELAY_STEP:
        reason = (
            f"the motion does not tell it well enough (confidence {confidence:.2f} and standard error {error:.3f} s; "
            f"{ENOUGH} and {MOST_ERROR} s are needed)"
        )
        return ClockOffset(0.0, confidence, error, best=-best, reason=reason)
    drift, middle = _drift(curves, middles, delays, best, draws), float(np.mean(middles))
    return ClockOffset(-best, confidence, error, -drift, middle, -best)


def _check_log(log: Any) -> None:
    if not isinstance(log, JointLog):
        raise DenseVSError(f"log is a {type(log).__name__}; expected a JointLog")


def _unknown(reason: str) -> ClockOffset:
    return ClockOffset(0.0, 0.0, float("nan"), reason=reason)


def _window_curves(
    pairs: np.ndarray, motion: np.ndarray, times: np.ndarray, joints: np.ndarray, delays: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unexplained motion of each window (W, L) [px^2] at each delay, and the windows' middles (W,) [s]."""
    windows = []
    start = pairs[0, 0]
    while start < pairs[-1, 1]:
        first, end = np.searchsorted(pairs[:, 0], start), np.searchsorted(pairs[:, 1], start + WINDOW, side="right")
        if end - first >= LEAST_PAIRS:
            windows.append((first, end))
        start += WINDOW / 2

    def each_window() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Joint steps and products of the flows; made anew, as those of a long recording would fill the memory."""
        for first, end in windows:
            yield joint_steps(pairs[first:end], delays, times, joints), motion[first:end] @ motion[first:end].T

    # A joint that by itself predicts little of the motion, as one that only shivers, must not dilute the others.
    singly = np.zeros((joints.shape[1], len(delays)))
    for steps, energy in each_window():
        for n in range(joints.shape[1]):
            singly[n] += np.trace(energy) - unexplained_by_constant_jacobian(steps[:, :, n : n + 1], energy)
    weights = np.maximum(singly.max(axis=1), 0.0)
    weights = (weights / max(weights.max(), 1e-12)) ** 2
    curves = [unexplained_by_constant_jacobian(steps * weights, energy) for steps, energy in each_window()]
    middles = [0.5 * (pairs[first, 0] + pairs[end - 1, 1]) for first, end in windows]
    return np.array(curves), np.array(middles)


def _drift(curves: np.ndarray, middles: np.ndarray, delays: np.ndarray, best: float, draws: list[np.ndarray]) -> float:
    """Change of the delay a second; 0 where it is short, or not three standard errors from 0."""
    seconds = float(np.ptp(middles))
    if seconds < LEAST_DRIFT_SECONDS:
        return 0.0
    rates = np.linspace(-0.2, 0.2, 161) / seconds
    around = middles - np.mean(middles)
    # Of every window at every rate, around the common delay.
    values = np.stack(
        [
            np.stack([np.interp(best + shift + rates * t, delays, row) for t, row in zip(around, curves, strict=True)])
            for shift in np.linspace(-0.02, 0.02, 5)
        ]
    )  # (shifts, windows, rates)

    def rate(chosen: np.ndarray | slice) -> float:
        return float(rates[int(np.argmin(values[:, chosen].sum(axis=1).min(axis=0)))])

    answer = rate(slice(None))
    spread = np.std([rate(chosen) for chosen in draws])
    return answer if abs(answer) > 3 * max(float(spread), 0.005 / seconds) else 0.0
