"""How a loop brings its point to a target: a planned move where the way is far, DIJE (17) near it, and back to look for
the point where it was lost."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dense_vs.health.faults import Fault, FaultKind
from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.following import given_up
from dense_vs.point_servo.point_on_link import POINT
from dense_vs.point_servo.posture_approach import PostureApproach
from dense_vs.point_servo.reach import Arrival, Reach, ReachEnd
from dense_vs.point_servo.tracker import PointTracker

if TYPE_CHECKING:
    from dense_vs.point_servo.loop import ServoLoop

FAR = 0.08  # of the image's width from the target, from which on a move is planned
NEAR = 0.025  # of it, at which DIJE (17) takes over
ARRIVED = 0.02  # rad from the planned posture
FASTEST = 0.02  # of the image's width a frame, by which the point moves at most: blur, and rows exposed one by one
PLANNED_EVERY = 15  # frames, after which the posture is planned anew, as the chain is known better by then
RETURNS = 1  # times in a reach that a lost point is looked for where it was defined
BACK = 0.01  # rad from the posture in which it was defined
LOOKED = 5  # frames there in which it is looked for
GONE = 45  # frames in which it is not known where the point is; those of a planned move, by the chain, do not count
CLOSER = 15  # frames at the target, in all, in which it may come closer: what is left adds to what is not known
WAITED = 45  # frames at the target, in all, after which a place that is not certain will not become so


class Reaching:
    """One reach.

    Args:
        loop: that a point is defined in.
        arrival: when it is at the loop's aim.
        max_frames: after which it gives up.
    """

    def __init__(self, loop: "ServoLoop", arrival: Arrival, max_frames: int):
        self._loop = loop
        self._arrival, self._left, self._frames = arrival, max_frames, 0
        self._faults: dict[FaultKind, Fault] = {}
        self._planned: np.ndarray | None = None
        self._planned_at = -PLANNED_EVERY
        self._approach = PostureApproach()
        self._under_way = False  # to a planned posture
        self._blind = loop.tracker.unseen if isinstance(loop.tracker, BodyTracker) else 0  # frames

    def run(self) -> Reach:
        """Go there."""
        loop = self._loop
        returns = waited = 0
        far = self._is_far()
        while self._left > 0 and waited < WAITED and not self._over(waited):
            if self._gone():
                if returns == RETURNS or not (self._find_again() or self._known()):
                    break
                returns += 1
                self._blind = 0
                far = self._is_far()
                continue
            far = far and self._distance() > NEAR * loop.estimator.options.width
            self._under_way = False
            self._step(self._way() if far else loop.servo_step)
            self._arrival.observe(self._distance(), blind=any(fault.stops for fault in loop.faults))
            self._look_out()
            waited += self._arrival.settled
        end = ReachEnd.REACHED if self._arrival.settled else ReachEnd.MISSED
        if not self._certain():
            end = ReachEnd.LOST
        target, faults = tuple(self._target.tolist()), tuple(self._faults.values())
        known = self._tracker.usual_uncertainty if isinstance(self._tracker, BodyTracker) else None
        return Reach(target, self._frames, self._distance(), end, faults, known)

    @property
    def _tracker(self) -> PointTracker | BodyTracker:
        """Of the point; another one once it was found again."""
        assert self._loop.tracker is not None  # without a point there is no aim
        return self._loop.tracker

    @property
    def _target(self) -> np.ndarray:
        assert self._loop.target is not None  # a reach has set it
        return self._loop.target

    def _over(self, waited: int) -> bool:
        """Whether the point is at the target for certain, and as close as it will come."""
        arrived = self._arrival.settled and (self._arrival.close or waited > CLOSER)
        return arrived and self._certain()

    def _certain(self) -> bool:
        """Whether it is known where the point is, which a patch alone does not tell where it should have had a link.

        What is wrong with J where no body could be learned, or hides the arm, misleads the patch as well; so does what
        leaves the point on no link of one that is known.
        """
        body, memory = self._loop.learned_body, self._loop.memory
        linkless = body.model is not None and memory is not None and memory.by_link
        alone = isinstance(self._tracker, PointTracker) and (body.sought_in_vain or linkless)
        return self._loop.aim.certain(self._tracker, self._arrival.tolerance) and not alone

    def _is_far(self) -> bool:
        """Whether a move is to be planned, which is for places in the image: a chain has no meters."""
        return len(self._target) == 2 and self._distance() > FAR * self._loop.estimator.options.width

    def _gone(self) -> bool:
        """Whether the point is lost, and for so long that it has to be looked for."""
        return given_up(self._tracker) or self._blind >= GONE

    def _look_out(self) -> None:
        """Count the frames in which nothing is seen of the point's link, or its place is known worse than it is near.

        On a planned way the links turn, and one may show nothing that can be followed for a while; the chain knows
        where it is meanwhile. At the target it is waited for, and then called lost there.
        """
        tracker, expected = self._tracker, self._under_way or self._arrival.settled
        vague = isinstance(tracker, BodyTracker) and tracker.uncertainty > NEAR * self._loop.estimator.options.width
        self._blind = self._blind + 1 if (vague or self._unseen()) and not expected else 0

    def _unseen(self) -> bool:
        """Whether the point is followed by its link, of which nothing is seen now."""
        tracker = self._tracker
        return isinstance(tracker, BodyTracker) and tracker.unseen > 0

    def _distance(self) -> float:
        return self._loop.aim.distance(self._loop.point)

    def _step(self, choose: Callable[[], np.ndarray]) -> None:
        loop = self._loop
        loop.step(loop.when_due(choose))
        self._left -= 1
        self._frames += 1
        self._faults |= {fault.kind: fault for fault in loop.faults}

    def _way(self) -> Callable[[], np.ndarray]:
        """What chooses the next step of a far way: toward a posture planned by the body's chain where there is one."""
        loop = self._loop
        tracker = self._tracker
        if isinstance(tracker, BodyTracker) and self._frames - self._planned_at >= PLANNED_EVERY:
            self._planned_at = self._frames
            self._planned = tracker.on_link.posture_for(
                self._target,
                loop.joints.newest,
                loop.group.limits,
                held=loop.joints.watch.stuck,
                start=self._planned,
            )
        posture = self._planned
        if posture is None or self._approach.over(posture, loop.joints.newest, ARRIVED):
            return loop.servo_step
        self._under_way = True
        return lambda: self._toward(posture)

    def _toward(self, posture: np.ndarray) -> np.ndarray:
        """Joint step ``(N,)`` straight to a posture, by the servo's gain and longest step and as the point may move."""
        loop, tracker, options = self._loop, self._tracker, self._loop.servo.options
        way, longest = posture - loop.joints.newest, options.max_step
        self._approach.sent(posture, loop.joints.newest)
        if isinstance(tracker, BodyTracker) and not tracker.unseen and way.any():
            motion = float(np.linalg.norm(tracker.features.jacobian(POINT, loop.joints.newest) @ way))
            share = FASTEST * loop.estimator.options.width / max(motion, 1e-12)
            longest = min(longest, share * float(np.abs(way).max()))
        return loop.group.step_toward(posture, loop.joints.newest, longest, min(options.gain, 1.0))

    def _find_again(self) -> bool:
        """Go back to the posture in which the point was defined, and look for it there; whether it is seen."""
        loop = self._loop
        memory = loop.memory
        if memory is None:
            return False
        looked = 0
        while self._left > 0 and looked < LOOKED:
            self._step(lambda: self._toward(memory.positions))
            self._arrival.observe(np.inf)  # on the way back it is not at its target, wherever it was
            there = self._approach.over(memory.positions, loop.frame.positions, BACK)
            if there and not any(fault.stops for fault in loop.faults):
                looked += 1
                if loop.find_again():
                    return True
        return not given_up(self._tracker) and not self._unseen()

    def _known(self) -> bool:
        """Whether the chain leads to the target, though nothing is seen of the point's link: it may be seen there."""
        tracker = self._tracker
        return isinstance(tracker, BodyTracker) and bool(np.isfinite(tracker.uncertainty))
