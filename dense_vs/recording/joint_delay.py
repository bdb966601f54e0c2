"""How far joint readings are behind the images: the delay at which joint steps explain the image motion best.

Over a second or two J changes little, so the flow at every pixel is nearly linear in the joint step. For each delay
tried, the joint positions are read that much later, and the flow's energy that no constant J explains is counted
(beyond the paper, which has one clock).
"""

import numpy as np

TRIED_FRAMES = np.arange(-2.0, 3.01, 0.25)  # frames
LEAST_FRAMES = 0.5  # of a delay that counts: a quarter of a frame cannot be told from none and costs little
LEAST_GAIN = 0.02  # share of the unexplained energy that the delay has to explain


def joint_delay(flow: np.ndarray, image_times: np.ndarray, times: np.ndarray, positions: np.ndarray) -> float:
    """Delay of the readings [s], below 0 where the images are late; 0 where none explains the motion clearly better.

    Args:
        flow: ``(K, M)`` image motion of K successive frames at some pixels, x and y alike [px].
        image_times: ``(K + 1,)`` stamps of their images [s].
        times: ``(S,)`` stamps of the joint readings [s], increasing; those up to 3 frames past the images are used.
        positions: ``(S, N)`` the readings [rad].
    """
    frame_time = float(np.median(np.diff(image_times)))
    delays = TRIED_FRAMES * frame_time
    unexplained = np.array([_unexplained(flow, image_times + delay, times, positions) for delay in delays])
    best = int(np.argmin(unexplained))
    now = unexplained[int(np.argmin(np.abs(delays)))]
    counts = abs(TRIED_FRAMES[best]) >= LEAST_FRAMES and unexplained[best] < (1 - LEAST_GAIN) * now
    return float(delays[best]) if counts else 0.0


def _unexplained(flow: np.ndarray, at: np.ndarray, times: np.ndarray, positions: np.ndarray) -> float:
    """Energy of the flow outside of what joint steps between those times span [px^2]."""
    joints = np.array([np.interp(at, times, joint) for joint in positions.T])
    steps = joints[:, 1:].T - joints[:, :-1].T
    left, sizes, _ = np.linalg.svd(steps, full_matrices=False)
    spanned = left[:, sizes > 1e-6 * sizes.max(initial=1e-12)]
    return float(np.sum(flow**2) - np.sum((spanned.T @ flow) ** 2))
