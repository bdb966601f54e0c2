"""The link that a point is on, looked for in the images of the babbling and where J is like the point's."""

from collections.abc import Iterable

import numpy as np

from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.pipeline.frame_pipeline import Frame
from dense_vs.point_servo.link_tracker import LinkTracker
from dense_vs.point_servo.same_surface import unlikeness

HISTORY = 150  # images that J was corrected by, in which the link is looked for
OWN_JOINT = 0.05  # of the largest column of J at a point: a joint with less does not move it


def link_tracker(
    estimator: DenseJacobian,
    history: Iterable[tuple[np.ndarray, np.ndarray]],
    frame: Frame,
    point: np.ndarray,
    *,
    window: int,
    lost_after: int,
) -> LinkTracker | None:
    """A tracker of the point ``(2,)`` [px] by its whole link; None where the images do not show how that moves.

    Args:
        estimator: says which joints move the point, and which pixels may be on its link.
        history: gray images with joint positions ``(N,)`` [rad], the oldest first.
        frame: the last one, in which the point is defined.
        point, window, lost_after: as in :class:`LinkTracker`.
    """
    seen = [*history]
    if not seen or seen[-1][0] is not frame.gray:
        seen.append((frame.gray, frame.positions))
    unlike = unlikeness(estimator, point)
    if unlike is None:
        return None
    moves = np.linalg.norm(estimator.at(point)[0], axis=0)
    joints = moves > OWN_JOINT * moves.max()
    tracker = LinkTracker(seen, point, unlike, joints=joints, window=window, lost_after=lost_after)
    return None if tracker.motion is None else tracker
