"""Why a point does not get to its target: not learned, a joint limit, a singular posture, or joints that do not follow.

It is asked only once the error has not fallen for a while, and looks at J at the point (beyond the paper):

- *not learned*: no joint step within reach moves the point in the image;
- *joint limit*: without limits the step would go on, with them less than a fifth of it is left;
- *singular*: J moves the point, but hardly in the direction of its target;
- else the joints are commanded and the point does not come nearer: something holds it, or J is wrong here.
"""

from typing import Any

import numpy as np

PATIENCE = 45  # frames without a smaller error
FALL = 0.95  # of the least error so far counts as smaller
LEAST_MOTION = 3.0  # px/rad: J of a point that the joints do not move
ALONG = 0.15  # share of J's largest singular value that moves the point along its error
LEFT = 0.2  # share of the wanted image motion that the limits leave
REACHED_PX = 1.0  # an error below it is no reason to worry


class Reachability:
    """Watches one point on its way to one target.

    Attributes:
        why: why it does not get there; "" while it does.
    """

    def __init__(self) -> None:
        self.why = ""
        self._least, self._frames = np.inf, 0

    def observe(self, J: Any, error: Any, positions: np.ndarray, limits: np.ndarray, damping: float) -> None:
        """Take a frame in which motion was commanded.

        Args:
            J: ``(2, N)`` at the point [px/rad].
            error: ``(2,)`` from the point to its target [px].
            positions, limits: ``(N,)`` and ``(N, 2)`` of the joints [rad].
            damping: of the law [px/rad].
        """
        J, error = np.asarray(J, dtype=np.float64), np.asarray(error, dtype=np.float64)
        distance = float(np.hypot(*error))
        if distance < FALL * self._least or distance < REACHED_PX:
            self._least, self._frames, self.why = min(distance, self._least), 0, ""
            return
        self._frames += 1
        if self._frames >= PATIENCE:
            self.why = reason(J, error, positions, limits, damping)


def reason(J: np.ndarray, error: np.ndarray, positions: np.ndarray, limits: np.ndarray, damping: float) -> str:
    """Why a point with J ``(2, N)`` does not move by ``error`` ``(2,)`` [px]; see the module."""
    sizes = np.linalg.svd(J, compute_uv=False)
    if sizes[0] < LEAST_MOTION:
        return "not learned: no joint is known to move this point"
    direction = error / max(float(np.hypot(*error)), 1e-9)
    along = float(np.linalg.norm(direction @ J))
    if along < ALONG * sizes[0]:
        return "singular: the joints hardly move this point towards its target"
    step = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(2), error)
    wanted = float(direction @ J @ step)
    margin = 0.01 * np.where(np.isfinite(limits).all(axis=1), np.ptp(limits, axis=1), 0.0)
    up, down = positions >= limits[:, 1] - margin, positions <= limits[:, 0] + margin
    held = (up & (step > 0)) | (down & (step < 0))
    free = J[:, ~held]
    others = free.T @ np.linalg.solve(free @ free.T + damping**2 * np.eye(2), error)
    if held.any() and float(direction @ free @ others) < LEFT * wanted:
        return f"joint limit: {'joints' if held.sum() > 1 else 'joint'} {', '.join(map(str, np.flatnonzero(held) + 1))}"
    if held.any():
        return f"held by joint limits ({', '.join(map(str, np.flatnonzero(held) + 1))}) or blocked"
    return "it does not come nearer: the joints do not follow, or J is wrong here"
