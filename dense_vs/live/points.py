"""The points that a user clicked: each is tracked, may have a target, and says how it is doing."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import Any

import numpy as np

from dense_vs.arrays import point_array
from dense_vs.checks import check_number, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.flow.estimator import FlowEstimator
from dense_vs.live.body_process import BodyProcess
from dense_vs.live.followers import BodyFollower, Follower, Following, PatchFollower
from dense_vs.live.reachability import Reachability
from dense_vs.pipeline.frame_pipeline import BODY_FLOW, FramePipeline, ProcessedFrame
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.loop import ServoLoop
from dense_vs.point_servo.reach import Arrival
from dense_vs.point_servo.same_surface import patch_weights
from dense_vs.point_servo.tracker import PointTracker, TrackerOptions

MOST_POINTS = 8
TOLERANCE, LEAVE = 1.0, 2.0  # px; a point that has arrived is left alone until it is farther than the second
SETTLE_FRAMES = 5
NEAR = 12.0  # px, between targets that count as one that moves


class PointState(StrEnum):
    """How a point is doing."""

    TRACKING = "tracking"
    UNCERTAIN = "uncertain"
    REACHED = "reached"
    LOST = "lost"
    UNREACHABLE = "unreachable"


@dataclass
class LivePoint:
    """A point of the robot.

    Attributes:
        number: names it for the user.
        follower: knows where it is.
        target: ``(2,)`` [px]; None without one.
        weight: how much its error counts beside the others'.
        arrival: watches whether it is at its target.
        reachability: watches whether its error falls.
    """

    number: int
    follower: Follower
    target: np.ndarray | None = None
    weight: float = 1.0
    arrival: Arrival = field(default_factory=lambda: Arrival(TOLERANCE, SETTLE_FRAMES, LEAVE))
    reachability: Reachability = field(default_factory=Reachability)

    @property
    def place(self) -> np.ndarray:
        """Where it is, ``(2,)`` [px]."""
        return self.follower.place

    @property
    def lost(self) -> bool:
        """Whether it is not known where it is."""
        return self.follower.lost

    @property
    def error(self) -> float:
        """Distance from its target [px]; NaN without one."""
        return float("nan") if self.target is None else float(np.hypot(*(self.place - self.target)))

    @property
    def state(self) -> PointState:
        """How it is doing."""
        if self.lost:
            return PointState.LOST
        if not self.follower.certain:
            return PointState.UNCERTAIN
        if self.target is not None and self.arrival.settled:
            return PointState.REACHED
        return PointState.UNREACHABLE if self.reachability.why else PointState.TRACKING

    @property
    def why(self) -> str:
        """What keeps it; empty where nothing does."""
        return self.follower.why or self.reachability.why


class LivePoints:
    """All points, and the joint step that brings them to their targets together.

    Args:
        height, width: of the filter's images [px].
        body: the process that knows the body; None where none is learned.
    """

    def __init__(self, height: int, width: int, body: BodyProcess | None = None):
        self._size = height, width
        # Sharp at outlines: a point near one would be carried off with the background.
        self._flow = FlowEstimator(BODY_FLOW, height, width)
        self._following = Following(self._flow, body)
        self._points: dict[int, LivePoint] = {}
        self._next = 1

    def __iter__(self):
        return iter(tuple(self._points.values()))

    def __len__(self) -> int:
        return len(self._points)

    def __contains__(self, number: int) -> bool:
        return number in self._points

    def add(self, place: Any, frames: Sequence[ProcessedFrame], pipeline: FramePipeline, number: int = 0) -> LivePoint:
        """Follow the point that is at ``place`` ``(2,)`` [px] in the first of ``frames``.

        The frames after it, up to the present one, carry the point along: what is seen in a browser is a little old.
        From there on the point is followed by its body once the body's process, which is told the present frame's
        ``number``, has found it there.

        Raises:
            DenseVSError: outside the image, or as many points as there may be.
        """
        if len(self._points) >= MOST_POINTS:
            raise DenseVSError(f"there are {MOST_POINTS} points already; expected one to be removed first")
        place = self._inside(place)
        seen = _weights(pipeline, place) if len(frames) == 1 else None  # J is the present frame's
        tracker = PointTracker(place, frames[0].gray, weights=seen)
        for before, after in pairwise(frames):
            tracker.update(self._flow(before.gray, after.gray), after.gray)
        if seen is None and not tracker.lost[0] and len(frames) > 1:
            now = np.clip(tracker.points, 0, np.array(self._size[::-1]) - 1)
            tracker.redefine(now, frames[-1].gray, _weights(pipeline, now[0]))
        point = LivePoint(self._next, PatchFollower(tracker, self._following.body))
        self._following.seek(point.number, point.follower, number, frames[-1], pipeline)
        self._points[point.number] = point
        self._next += 1
        return point

    def remove(self, number: int) -> None:
        """Follow a point no longer."""
        self._points.pop(self._at(number).number)
        if self._following.body is not None:
            self._following.body.drop(number)

    def clear(self) -> None:
        """Follow none."""
        for number in tuple(self._points):
            self.remove(number)

    def aim(self, number: int, target: Any) -> None:
        """Give a point a target ``(2,)`` [px], or none.

        Raises:
            DenseVSError: no such point, or a target that is not in the image.
        """
        point = self._at(number)
        place = None if target is None else self._inside(target)
        # A target that is dragged, or moves by itself, comes in small steps: they begin nothing anew.
        if place is None or point.target is None or np.hypot(*(place - point.target)) > NEAR:
            point.arrival, point.reachability = Arrival(TOLERANCE, SETTLE_FRAMES, LEAVE), Reachability()
        point.target = place

    def weigh(self, number: int, weight: float) -> None:
        """Say how much a point's error counts.

        Raises:
            DenseVSError: no such point, or a weight that is not in (0, 100].
        """
        self._at(number).weight = check_number("weight", weight, above=0, most=100)

    def follow(self, before: ProcessedFrame, now: ProcessedFrame, pipeline: FramePipeline, number: int = 0) -> None:
        """Carry all points into a new frame of that number."""
        if not self._points or before is now:
            return
        followers = {point.number: point.follower for point in self}
        self._following.carry(followers, before, now, number, pipeline)
        blind = any(fault.stops for fault in now.faults)
        for point in self:
            point.follower = followers[point.number]
            if point.target is not None and (point.follower.fresh or point.error > LEAVE):
                point.arrival.observe(point.error, blind=blind or point.lost)

    def seek_by_body(self, now: ProcessedFrame, pipeline: FramePipeline, number: int) -> None:
        """The body is known now: let all points be followed by it."""
        for point in self:
            self._following.seek(point.number, point.follower, number, now, pipeline)

    def follow_by_patches(self, now: ProcessedFrame, pipeline: FramePipeline) -> None:
        """The body was forgotten: let all points be followed by how they look now."""
        highest = np.array(self._size[::-1]) - 1
        for point in self:
            if isinstance(point.follower, BodyFollower):
                place = np.clip(point.place, 0, highest)
                tracker = PointTracker(place, now.gray, weights=_weights(pipeline, place))
                point.follower = PatchFollower(tracker, self._following.body)

    def step(self, servo: VisualServo, loop: ServoLoop) -> np.ndarray:
        """The joint step ``(N,)`` [rad] towards the targets; zero where no point has one. Lost points do not count."""
        chosen = [point for point in self if point.target is not None and not point.lost]
        if all(point.arrival.settled for point in chosen):
            return np.zeros(servo.joints)
        seen = np.array([point.place for point in chosen])
        J = np.asarray(loop.estimator.at(seen))
        q = loop.joints.newest
        places = seen + J @ (q - loop.frame.positions)  # where they are by now, as far as an image comes late
        targets, weights = np.array([point.target for point in chosen]), np.array([point.weight for point in chosen])
        step = servo.together(J, places, targets, weights, q, held=loop.joints.watch.stuck)
        for point, own in zip(chosen, J, strict=True):
            error = point.target - point.place
            point.reachability.observe(own, error, q, loop.group.limits, servo.options.damping)
        return step

    @property
    def worst_error(self) -> float:
        """The largest error of all points with a target [px]; NaN where there is none."""
        errors = [point.error for point in self if point.target is not None]
        return max(errors) if errors else float("nan")

    def _inside(self, place: Any) -> np.ndarray:
        point, (height, width) = point_array(place, "point"), self._size
        if not (0 <= point[0] <= width - 1 and 0 <= point[1] <= height - 1):
            raise DenseVSError(f"point {point.tolist()} is outside the image of {width} x {height} pixels")
        return point

    def _at(self, number: int) -> LivePoint:
        if check_whole("point", number) not in self._points:
            present = ", ".join(map(str, self._points)) or "none"
            raise DenseVSError(f"point is {number!r}; expected one of {present}")
        return self._points[number]


def _weights(pipeline: FramePipeline, place: np.ndarray) -> np.ndarray | None:
    """Which pixels count in the patch of a new tracker."""
    return patch_weights(pipeline, place, TrackerOptions().window)
