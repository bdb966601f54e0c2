"""Joint positions as they are read: late, noisy or rounded, where the world is asked to be so."""

from collections.abc import Callable

import numpy as np

from dense_vs.sims.engine.compliance import Compliance
from dense_vs.sims.engine.realism import Realism


class JointReadings:
    """Readings of the encoders of B worlds.

    Args:
        compliance: with its noise of the readings.
        realism: how late, noisy and coarse they are.
        random: a world's generator, the same whenever the present frame's readings are asked for.
    """

    def __init__(
        self,
        compliance: Compliance | None,
        realism: Realism | None,
        random: Callable[[int], np.random.Generator],
    ):
        of_compliance = compliance.reading_noise if compliance is not None else 0.0
        self._noise = float(np.hypot(of_compliance, realism.joint_noise if realism is not None else 0.0))
        self._resolution = 0.0 if realism is None else realism.joint_resolution
        self._realism, self._random = realism, random
        self.begin()

    def begin(self) -> None:
        """Forget earlier frames."""
        self._earlier: list[np.ndarray] = []  # of the frames that readings are late by, the oldest first

    def remember(self, history: Callable[[], np.ndarray]) -> None:
        """Keep the positions (B, S, N) of the frame that ends, asked for only where readings come late."""
        late = 0 if self._realism is None else self._realism.late_frames
        if late:
            self._earlier = [*self._earlier, history()][-late:]

    def of(self, positions: np.ndarray) -> np.ndarray:
        """Readings (B, S, N) for the present frame's last S positions [rad]."""
        worlds, count, joints = positions.shape
        read = positions.copy()
        if self._earlier:
            first = self._earlier[0]  # of one position before the first step
            read = first[:, -count:].copy() if first.shape[1] >= count else np.repeat(first[:, -1:], count, axis=1)
        if self._noise:
            # The last reading first, so that it is the same alone.
            noise = [self._random(world).normal(0.0, self._noise, (count, joints))[::-1] for world in range(worlds)]
            read += np.stack(noise)
        return np.rint(read / self._resolution) * self._resolution if self._resolution else read
