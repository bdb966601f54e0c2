"""Following a point, by whichever tracker follows it, and what sets the pace of babbling."""

import numpy as np

from dense_vs.device import one_blas_thread
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.pipeline.frame_pipeline import BODY_FLOW, LEARNED_UPDATES, MOST_BRIDGED, FramePipeline, ProcessedFrame
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.learned_body import LearnedBody
from dense_vs.point_servo.point_memory import PointMemory
from dense_vs.point_servo.point_on_link import POINT
from dense_vs.point_servo.same_surface import patch_weights
from dense_vs.point_servo.tracker import PointTracker

AROUND = 160  # px, side of a point's surroundings that flow is found in; coarse levels bridge a quarter of it
VAGUE = 3.0  # px, standard deviation of a point's place from which on that is said
LEAST_BODY = 0.01  # share of the image that makes the robot's own pixels count as known


def new_tracker(memory: PointMemory, frame: ProcessedFrame, body: LearnedBody | None) -> PointTracker | BodyTracker:
    """A tracker of the point that a memory has of the last frame: by its link where ``body`` knows it."""
    options = {name: memory.options[name] for name in ("window", "lost_after")}
    link = None if body is None else body.tracker(memory.place, frame, **options)
    return link or memory.tracker()


def found_again(
    memory: PointMemory, tracker: PointTracker | BodyTracker | None, frame: ProcessedFrame
) -> PointTracker | BodyTracker | None:
    """A tracker that goes on in a frame from the posture that the point was defined in; None where it is not seen."""
    seen = memory.seen_in(frame.gray)
    if seen is None or not isinstance(tracker, BodyTracker):
        return seen
    return tracker if tracker.find_again(frame.gray, frame.positions) else None


class PointFlow:
    """Flow that a point is carried by, of its surroundings alone: a whole image's takes ten times as long.

    Sharper at outlines than J's needs to be: a point near one would be carried off with the background.

    Args:
        height, width: image size [px].
    """

    def __init__(self, height: int, width: int):
        self._around = min(AROUND, height), min(AROUND, width)
        self._flow = FlowEstimator(BODY_FLOW, *self._around)
        self._image = np.zeros((height, width, 2), np.float32)
        self._where = np.s_[:0, :0]

    def __call__(self, previous_gray: np.ndarray, gray: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Flow of the present image, float32 ``(H, W, 2)`` [px], valid until the next call; 0 away from the point.

        Args:
            previous_gray, gray: uint8 ``(H, W)``.
            point: ``(2,)`` in the previous image [px].
        """
        shape = self._image.shape[:2]
        starts = (round(float(at)) - side // 2 for at, side in zip(point[::-1], self._around, strict=True))
        top, left = (
            min(max(start, 0), size - side) for start, size, side in zip(starts, shape, self._around, strict=True)
        )
        self._image[self._where] = 0.0
        self._where = np.s_[top : top + self._around[0], left : left + self._around[1]]
        self._image[self._where] = self._flow(previous_gray[self._where], gray[self._where])
        return self._image


@one_blas_thread()
def follow(
    tracker: PointTracker | BodyTracker,
    pipeline: FramePipeline,
    point_flow: PointFlow,
    last: ProcessedFrame,
    frame: ProcessedFrame,
    renew_patch: float | None,
) -> str:
    """Take a point along from one frame to another; why it is not seen, empty where it is."""
    estimator = pipeline.estimator
    if isinstance(tracker, BodyTracker):
        tracker.update(frame.gray, frame.positions)
        return _why_unseen(tracker, pipeline)
    dq = frame.positions - last.positions
    if pipeline.motion(dq) > MOST_BRIDGED:
        flow = estimator.predicted_flow(dq)
    else:
        flow = point_flow(last.gray, frame.gray, tracker.points[0])
    tracker.update(flow, frame.gray)
    correlation, least = float(tracker.correlation[0]), tracker.options.min_correlation
    if renew_patch is not None:
        renew(tracker, pipeline, frame.gray, renew_patch)
    return f"its surroundings correlate by {correlation:.2f} with how they were" if correlation < least else ""


def renew(tracker: PointTracker, pipeline: FramePipeline, gray: np.ndarray, below: float) -> None:
    """Take a point's patch anew as its surface turns, but not where it does not align: something else may cover it.

    Args:
        tracker: of the point.
        pipeline: that tells which pixels move as the point does.
        gray: uint8 ``(H, W)``, the present image.
        below: correlation below which the patch is taken anew.
    """
    options = tracker.options
    if not tracker.lost[0] and options.min_correlation <= float(tracker.correlation[0]) < below:
        tracker.redefine(tracker.points, gray, patch_weights(pipeline, tracker.points[0], options.window))


def _why_unseen(tracker: BodyTracker, pipeline: FramePipeline) -> str:
    if tracker.unseen:
        return "too few features of its link are seen where they are expected"
    if not in_sight(tracker.point, pipeline):
        x, y = tracker.point
        why = "something covers it" if pipeline.hidden_at(tracker.point) else f"({x:.0f}, {y:.0f}) is out of the image"
        return f"{why}; by the rest of its link it is known to {tracker.uncertainty:.1f} px"
    if tracker.uncertainty > VAGUE:
        return f"its place is known to {tracker.uncertainty:.1f} px only"
    return ""


def in_sight(point: np.ndarray, pipeline: FramePipeline) -> bool:
    """Whether a place ``(2,)`` [px] is inside the image and nothing covers the body there."""
    options = pipeline.estimator.options
    inside = (point >= 0).all() and (point <= (options.width - 1, options.height - 1)).all()
    return bool(inside) and not pipeline.hidden_at(point)


def point_jacobian(tracker: PointTracker | BodyTracker, pipeline: FramePipeline, positions: np.ndarray) -> np.ndarray:
    """J ``(2, N)`` of the tracked point [px/rad]: DIJE (16), or where it is not in sight, nor its link, by the chain.

    Args:
        tracker: of the point.
        pipeline: whose J is asked where the point is seen.
        positions: joint positions ``(N,)`` of the last image [rad].
    """
    point = tracker.points[0]
    if not isinstance(tracker, BodyTracker) or (not tracker.unseen and in_sight(point, pipeline)):
        return pipeline.estimator.at(point)[0]
    return tracker.features.jacobian(POINT, positions)


def certain(tracker: PointTracker | BodyTracker, tolerance: float = 1.0) -> bool:
    """Whether it is known where the point is, as well as a tolerance [px] asks for."""
    return tracker.certain(tolerance) if isinstance(tracker, BodyTracker) else not given_up(tracker)


def given_up(tracker: PointTracker | BodyTracker) -> bool:
    """Whether the point is lost and not sought."""
    return isinstance(tracker, PointTracker) and bool(tracker.lost[0])


def pacing_flow(pipeline: FramePipeline, frame: ProcessedFrame) -> np.ndarray | None:
    """The last frame's image motion: J dq once J is learned, which neither noise nor others' motion slows down.

    Without what is known not to be the robot, once the robot itself is known.
    """
    estimator, body = pipeline.estimator, pipeline.body
    if frame.dq is None:
        return None
    learned = estimator.updates > LEARNED_UPDATES
    flow = estimator.predicted_flow(frame.dq) if learned else frame.flow
    if flow is None or body is None:
        return flow
    found = body.recognition(estimator.jacobian)
    if np.mean(found == 1) < LEAST_BODY:
        return flow
    return np.where((found == 0)[..., None], np.float32(np.nan), flow)
