"""What a clicked point is followed by: its own patch, or, once the body is known, its whole link, in a process apart.

The process answers some frames late. In between the point goes on by J dq, and an answer corrects the place that it had
in the answer's frame, so nothing waits for it.
"""

from collections import deque
from typing import Protocol

import numpy as np

from dense_vs.flow.estimator import FlowEstimator
from dense_vs.live.body_process import BodyProcess
from dense_vs.live.seen_point import SeenPoint
from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame
from dense_vs.point_servo.following import certain, given_up, renew
from dense_vs.point_servo.tracker import PointTracker

RENEW_PATCH = 0.93  # correlation below which a patch is taken anew, as the surface turns
FRESH = 5  # frames that an answer may be old for what is seen now to count as seen
STALE = 45  # frames without an answer after which it is no longer certain where the point is
KEPT = 120  # places that an answer may be about


class Follower(Protocol):
    """Knows where one point is.

    Attributes:
        place: ``(2,)`` [px].
    """

    place: np.ndarray

    @property
    def certain(self) -> bool:
        """Whether it is known where the point is."""
        ...

    @property
    def lost(self) -> bool:
        """Whether it is not."""
        ...

    @property
    def fresh(self) -> bool:
        """Whether the place is one that was just seen."""
        ...

    @property
    def why(self) -> str:
        """Why it is not certain; empty where it is."""
        ...


class PatchFollower:
    """By a tracker of its own patch, in the loop's thread.

    Args:
        tracker: of the point alone.
        body: the process that seeks the body; None where none is learned.

    Attributes:
        linkless: whether the body is known, and has no link that the point is on.
    """

    fresh = True

    def __init__(self, tracker: PointTracker, body: BodyProcess | None):
        self.tracker, self._body = tracker, body
        self.place, self.linkless = tracker.points[0], False

    @property
    def doubted(self) -> bool:
        """Whether it should have had a link: what hides the arm, or is wrong with J, misleads a patch as well."""
        return self._body is not None and (self._body.sought_in_vain or (self.linkless and self._body.knows))

    @property
    def certain(self) -> bool:
        """As of the loop."""
        return certain(self.tracker) and not self.doubted

    @property
    def lost(self) -> bool:
        """As of the loop."""
        return given_up(self.tracker)

    @property
    def why(self) -> str:
        """Why it is lost, or not believed."""
        if self.lost:
            return "its surroundings look otherwise now"
        if self._body is None or not self.doubted:
            return ""
        cause = "the body was not found" if self._body.sought_in_vain else "it is on no link that is known"
        return f"followed by its surroundings alone, as {cause}"

    def update(self, flow: np.ndarray, now: ProcessedFrame, pipeline: FramePipeline) -> None:
        """Take the point into a frame by the flow since the last."""
        tracker = self.tracker
        tracker.update(flow, now.gray)
        renew(tracker, pipeline, now.gray, RENEW_PATCH)
        self.place = tracker.points[0]


class BodyFollower:
    """By its link.

    Args:
        body: the process that follows it.
        place: ``(2,)`` where it is now [px].
        number: of the frame of the first answer.
        seen: that answer.
    """

    def __init__(self, body: BodyProcess, place: np.ndarray, number: int, seen: SeenPoint):
        self._body, self._seen = body, seen
        self.place = place.copy()
        self._heard = self._now = number
        self._past: deque[tuple[int, np.ndarray]] = deque(maxlen=KEPT)

    @property
    def certain(self) -> bool:
        """As of the body, by an answer that is not too old."""
        return self._seen.certain and not self.lost and self._now - self._heard <= STALE

    @property
    def lost(self) -> bool:
        """Whether its link is not seen, though it is still sought, or nobody seeks it."""
        return self._seen.lost or not self._body.alive

    @property
    def fresh(self) -> bool:
        """Whether the last answer is of a frame that just was."""
        return self._now - self._heard <= FRESH

    @property
    def why(self) -> str:
        """What is uncertain."""
        if not self._body.alive:
            return "the body's process ended"
        if self._seen.lost:
            return "too little is seen of its link"
        if self._now - self._heard > STALE:
            return "the body's process is late"
        return "" if self._seen.certain else f"known to about {2 * self._seen.uncertainty:.1f} px"

    def carry(self, number: int, motion: np.ndarray) -> None:
        """Go on by an image motion ``(2,)`` [px] into a frame."""
        self._now = number
        self.place = self.place + motion
        self._past.append((number, self.place.copy()))

    def take(self, number: int, seen: SeenPoint) -> None:
        """Correct the place by an answer about a frame."""
        self._heard, self._seen = number, seen
        had = next((place for one, place in self._past if one == number), None)
        if had is None or not np.isfinite(seen.place).all():
            return
        off = seen.place - had
        self.place = self.place + off
        self._past = deque(((one, place + off) for one, place in self._past if one >= number), maxlen=KEPT)


class Following:
    """Carries points' followers from frame to frame.

    Args:
        flow: for patches.
        body: the process that knows the body; None where none is learned.
    """

    def __init__(self, flow: FlowEstimator, body: BodyProcess | None):
        self._flow, self.body = flow, body

    def carry(
        self,
        followers: dict[int, Follower],
        before: ProcessedFrame,
        now: ProcessedFrame,
        number: int,
        pipeline: FramePipeline,
    ) -> None:
        """Take all followers, by point, into a frame; one whose body is found is replaced."""
        patches = [one for one in followers.values() if isinstance(one, PatchFollower)]
        flow = self._flow(before.gray, now.gray) if patches else None
        for follower in patches:
            assert flow is not None
            follower.update(flow, now, pipeline)
        by_body = [one for one in followers.values() if isinstance(one, BodyFollower)]
        if by_body:
            J = np.asarray(pipeline.estimator.at(np.array([one.place for one in by_body])), np.float64)
            for follower, own in zip(by_body, J, strict=True):
                follower.carry(number, own @ (now.positions - before.positions))
        if self.body is not None:
            self._hear(self.body, followers)

    def seek(self, point: int, follower: Follower, number: int, frame: ProcessedFrame, pipeline: FramePipeline) -> None:
        """Ask the body's process to follow a point that is known now, where it knows the body."""
        body = self.body
        if body is not None and body.knows and not follower.lost:
            body.follow(point, follower.place, number, frame, pipeline.estimator.to_numpy().copy())

    def _hear(self, body: BodyProcess, followers: dict[int, Follower]) -> None:
        for number, seen in body.answers():
            for point, one in seen.items():
                follower = followers.get(point)
                if one is None:
                    if isinstance(follower, PatchFollower):
                        follower.linkless = True
                elif isinstance(follower, BodyFollower):
                    follower.take(number, one)
                elif follower is not None:
                    followers[point] = BodyFollower(body, follower.place, number, one)
