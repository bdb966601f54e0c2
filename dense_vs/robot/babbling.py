"""Motor babbling: random joint motion that excites every joint independently, before J is known.

The filter learns J only along the joint steps it has seen, so their second-moment matrix sum(dq dq^T) must have
rank N. Sinusoids of one frequency span two dimensions whatever their phases. Each joint here follows
its own Ornstein-Uhlenbeck process, smoothed once, which spans all of them within a few seconds. In ten seconds chance
would still leave some combination of joints with a tenth of the motion of another, so directions that have moved less
so far are kicked harder.

Wider motion tells more of the body's axes and depths; where it ends, J is known best. So a loop that learns the body
swings wider for some seconds and then as before (beyond DIJE; measured in docs/body_model_history.md).
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_number, check_seed, check_whole

SPEEDS_UP = 1.05  # by which the pace grows in a frame that allows it; by the flow it falls at once

MOST_AMPLITUDE = 1e6  # rad, m; steps and postures stay finite
WIDE_AMPLITUDE = 0.35  # rad, m, of a loop that learns the body
WIDENING = 3.3, 5.0, 7.2, 8.7  # s: joints swing wider from the first to the last, most between the others
PAUSE = 2.0  # s between two steps, beyond which there was no babbling meanwhile


@dataclass(frozen=True, kw_only=True)
class BabblingOptions:
    """How the joints babble.

    Attributes:
        amplitude: standard deviation of a joint's excursion [rad]; it stays within three of them.
        time_constant: of the random process [s]; smaller is livelier.
        max_flow: image motion that the babbling slows down to, 99th percentile [px per frame]. Optical flow
            gets unreliable above about 5.
        frame_time: time between frames [s].
        wide_amplitude: what ``amplitude`` grows to and shrinks from in the middle of the first ten seconds [rad]; it
            does not unless given.
    """

    amplitude: float = 0.15
    time_constant: float = 0.4
    max_flow: float = 4.0
    frame_time: float = 1 / 30
    wide_amplitude: float | None = None

    def __post_init__(self):
        for field in fields(self):
            most = {"most": MOST_AMPLITUDE} if "amplitude" in field.name else {}
            value = getattr(self, field.name)
            if value is not None or field.name != "wide_amplitude":
                object.__setattr__(self, field.name, check_number(field.name, value, above=0, **most))


class Babbling:
    """Joint steps of smooth random motion about a posture.

    Args:
        joints: number of joints N.
        seed: of the random process.
        amplitude: standard deviation of a joint's excursion [rad]; it stays within three of them.
        time_constant: of the random process [s]; smaller is livelier.
        max_flow: image motion that the babbling slows down to, 99th percentile [px per frame].
        frame_time: time between frames [s].
        wide_amplitude: of excursions in the middle of the first ten seconds [rad]; as at other times unless given.

    Attributes:
        joints: N.

    Raises:
        DenseVSError: a value out of range.
    """

    def __init__(
        self,
        joints: int,
        *,
        seed: int = 0,
        amplitude: float = 0.15,
        time_constant: float = 0.4,
        max_flow: float = 4.0,
        frame_time: float = 1 / 30,
        wide_amplitude: float | None = None,
    ):
        self.joints = joints = check_whole("joints", joints, least=1, most=4096)
        self.options = BabblingOptions(
            amplitude=amplitude, time_constant=time_constant, max_flow=max_flow, frame_time=frame_time,
            wide_amplitude=wide_amplitude,
        )  # fmt: skip
        self.rate = 0.5
        self._seconds = 0.0  # of babbling until the next step
        self._last: float | None = None  # time of the last one [s]
        self._random = np.random.default_rng(check_seed(seed))
        self._noise = np.zeros(joints)
        self._offset = np.zeros(joints)
        self._moments = np.zeros((joints, joints))

    @property
    def largest_step(self) -> float:
        """What no step of a joint exceeds [rad]: six standard deviations of the process at full speed."""
        options = self.options
        return 6 * options.amplitude * min(options.frame_time / options.time_constant, 0.5)

    @property
    def amplitude(self) -> float:
        """Standard deviation of a joint's excursion at present [rad]."""
        options = self.options
        if options.wide_amplitude is None:
            return options.amplitude
        usual, wide = options.amplitude, options.wide_amplitude
        return float(np.interp(self._seconds, WIDENING, (usual, wide, wide, usual)))

    @property
    def excitation(self) -> float:
        """Smallest eigenvalue of sum(dq dq^T) so far [rad^2]; J is known to about sqrt(r / excitation)."""
        return float(np.linalg.eigvalsh(self._moments)[0])

    def step(self, flow: Any = None, time: float | None = None) -> np.ndarray:
        """The next joint step ``(N,)`` [rad].

        Args:
            flow: ``(H, W, 2)`` [px], the last frame's flow; where given, it sets the pace.
            time: present time on the camera's clock [s], which tells when to swing wider: images may be rarer than
                ``frame_time``, or be dropped. Steps are that far apart unless given.

        Raises:
            DenseVSError: a flow of another shape, or that holds no numbers, or a time that is no number; nothing has
                changed.
        """
        now = None if time is None else check_number("time", time)
        if flow is not None:
            self._adapt(number_array(flow, "flow", (-1, -1, 2), finite=False))
        self._take_time(now)
        amplitude = self.amplitude
        self._seconds += self.options.frame_time
        dt = min(self.rate * self.options.frame_time / self.options.time_constant, 0.5)
        kick = self._balanced(self._random.normal(size=self._noise.shape))
        self._noise += -dt * self._noise + np.sqrt(2 * dt) * kick
        # A first-order lag of a unit OU process of the same time constant has variance 1/2.
        goal = np.sqrt(2) * amplitude * self._noise
        moved = np.clip(self._offset + dt * (goal - self._offset), -3 * amplitude, 3 * amplitude)
        delta = np.clip(moved - self._offset, -self.largest_step, self.largest_step)
        moved = self._offset + delta
        self._offset = moved
        self._moments += np.outer(delta, delta)
        return delta

    def _take_time(self, now: float | None) -> None:
        """Count the time that has passed since the last step, in place of ``frame_time``; not that of a pause."""
        if now is not None and self._last is not None and 0 <= now - self._last <= PAUSE:
            self._seconds += now - self._last - self.options.frame_time
        self._last = now

    def _adapt(self, flow: np.ndarray) -> None:
        """Slow down at once where the image moves too fast, speed up a little where it does not."""
        speed = np.abs(flow[::4, ::4]).max(axis=2)
        moving = speed[np.isfinite(speed)]
        fastest = float(np.percentile(moving, 99)) if moving.size else 0.0
        if fastest > self.options.max_flow:
            self.rate = max(self.rate * max(self.options.max_flow / fastest, 0.5), 0.02)
        else:
            self.rate = min(self.rate * SPEEDS_UP, 1.0)

    def _balanced(self, kick: np.ndarray) -> np.ndarray:
        """The kick, turned toward what the steps so far moved less, and as strong as before.

        With their second moments M it is multiplied by (I - M / (2 tr M))^2N, about exp(-N M / tr M): by 1/e where
        a direction has the mean moment, by 1 where it has none.
        """
        joints, trace = len(kick), float(np.trace(self._moments))
        if trace == 0:
            return kick
        turned = np.linalg.matrix_power(np.eye(joints) - self._moments / (2 * trace), 2 * joints) @ kick
        return turned * (np.linalg.norm(kick) / np.linalg.norm(turned))
