"""When to stop sending a robot to a posture: it is there, or more steps would not bring it there."""

import numpy as np

STALLED = 30  # steps that bring the robot no nearer to a posture, after which more of them would not either
NEARER = 1e-3  # rad, m, by which it comes nearer, or it does not
ANOTHER = 0.02  # rad, m, from which on a posture is another one


class PostureApproach:
    """Whether there is more to come of sending a robot to a posture."""

    def __init__(self) -> None:
        self._posture: np.ndarray | None = None
        self._least, self._steps = np.inf, 0

    def sent(self, posture: np.ndarray, positions: np.ndarray) -> None:
        """Note a step toward a posture ``(N,)`` from positions ``(N,)`` [rad, m]; to another one they count anew."""
        if not self._is_toward(posture):
            self._posture, self._least, self._steps = posture, np.inf, 0
        way = float(np.abs(posture - positions).max())
        if self._steps < STALLED:  # once it has given up it has
            nearer = way < self._least - NEARER
            self._least, self._steps = (way, 0) if nearer else (self._least, self._steps + 1)

    def over(self, posture: np.ndarray, positions: np.ndarray, near: float) -> bool:
        """Whether it is within ``near`` of a posture, or :data:`STALLED` steps brought it no nearer: something holds
        it, or it swings.
        """
        there = bool(np.abs(posture - positions).max() < near)
        return there or (self._is_toward(posture) and self._steps >= STALLED)

    def _is_toward(self, posture: np.ndarray) -> bool:
        return self._posture is not None and bool(np.abs(posture - self._posture).max() <= ANOTHER)
