"""When babbling has taught enough: the image motion that J explains, how sure each joint's column is, and the body.

J is tested one frame ahead, before it sees the frame: E of :class:`ExplainedMotion` over the last two seconds. It is
good enough where E is high and each joint is sure; where E is lower and no longer rises, more of the same motion would
bring no more, and that is said with its figure. Where a body is to be learned too, babbling goes on until there are
images enough to fit it to: a slow computer or camera gives only a few a second. Beyond the paper, which babbles for a
set time.
"""

import numpy as np

from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.explained_motion import ExplainedMotion

LEAST_SECONDS, MOST_SECONDS = 4.0, 45.0
MOST_FOR_BODY = 90.0  # s that images are waited for, where J is good already
WINDOW = 2.0  # s that E is taken over
GOOD, USEFUL = 0.9, 0.5
RISE = 0.01  # of E from one window to the next that counts as still learning
SURE = 0.8
GRID = 8  # px


class Learning:
    """Watches one babbling.

    Args:
        explained: of the session; goes on after the babbling.
        time: when it began [s].
    """

    def __init__(self, explained: ExplainedMotion, time: float):
        self._explained, self._begin = explained, time
        self._useful = False

    def verdict(self, time: float, sureness: np.ndarray, images_missing: int = 0) -> tuple[bool, str] | None:
        """Whether J is good enough, and in words; None while it is to go on.

        Args:
            time: now [s].
            sureness: ``(N,)`` of :func:`sureness`.
            images_missing: that a body is still to be learned from.
        """
        seconds = time - self._begin
        if seconds < LEAST_SECONDS:
            return None
        now = self._explained.explained(time - WINDOW, time)
        before = self._explained.explained(time - 2 * WINDOW, time - WINDOW)
        unsure = np.flatnonzero(sureness < SURE) + 1
        share = f"J explains {100 * now:.0f} % of the motion" if np.isfinite(now) else "nothing moved in the image"
        # Few images a second make E uncertain: what it was once is enough to wait for more.
        self._useful |= now >= USEFUL and not unsure.size
        if images_missing and self._useful and seconds < MOST_FOR_BODY:
            return None
        if now >= GOOD and not unsure.size:
            return True, f"{share} after {seconds:.0f} s"
        stalled = seconds > 6 * WINDOW and np.isfinite(before) and now - before < RISE
        if stalled and now >= USEFUL and not unsure.size:
            return True, f"{share} after {seconds:.0f} s and no longer improves"
        if seconds >= MOST_SECONDS:
            doubt = f"; not learned: joint {', '.join(map(str, unsure))}" if unsure.size else ""
            return False, f"{share} after {seconds:.0f} s{doubt}"
        return None


def sureness(estimator: DenseJacobian) -> np.ndarray:
    """How well each joint is learned, ``(N,)`` from 0 to 1: its column's size beside the filter's own deviation.

    The size over the sum of both, where the size is what one pixel in twenty exceeds.
    """
    columns = np.linalg.norm(estimator.to_numpy()[::GRID, ::GRID], axis=2).reshape(-1, estimator.options.joints)
    sizes = np.quantile(np.nan_to_num(columns), 0.95, axis=0)
    variance = estimator.variance[::GRID, ::GRID].reshape(-1, estimator.options.joints).mean(axis=0)
    deviation = np.sqrt(np.maximum(variance, 0.0))
    with np.errstate(invalid="ignore"):
        found = sizes / (sizes + deviation)
    return np.where(np.isfinite(found), found, 0.0)
