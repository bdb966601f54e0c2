"""A loop that only counts, for reaches: its point goes toward its target, its robot where it is sent."""

from types import SimpleNamespace

import numpy as np

from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.tracker import PointTracker
from dense_vs.robot.joint_group import JointGroup

WIDTH = 200


class Loop:
    """The point goes toward its target by ``speed`` px a step; steps are kept with what chose them."""

    def __init__(self, away=50.0, speed=1.0, tracker=None):
        self.estimator = SimpleNamespace(options=SimpleNamespace(width=WIDTH))
        self.target, self.point, self.steps, self.found = np.zeros(2), np.array([away, 0.0]), [], []
        self.speed, self.tracker, self.certain = speed, tracker or point_tracker(), True
        self.learned_body = SimpleNamespace(sought_in_vain=False, model=None)
        self.aim = SimpleNamespace(distance=lambda point: float(np.hypot(*point)), certain=self._is_certain)
        self.joints = SimpleNamespace(newest=np.zeros(2), watch=SimpleNamespace(stuck=np.array([False, True])))
        self.group = SimpleNamespace(limits="limits", clip_step=lambda step, q: np.clip(step, -0.5, 0.5))
        self.group.step_toward = lambda *way: JointGroup.step_toward(self.group, *way)
        self.servo = SimpleNamespace(options=SimpleNamespace(max_step=0.03, gain=1.0))
        self.frame, self.faults, self.memory = SimpleNamespace(positions=np.zeros(2)), [], None

    def _is_certain(self, tracker, tolerance):
        """What ``certain`` says, of any tolerance where that is no number."""
        assert tracker is self.tracker
        return self.certain if isinstance(self.certain, bool) else tolerance >= self.certain

    def servo_step(self):
        return "servo"

    def when_due(self, choose):
        return choose()

    def step(self, command):
        self.steps.append(command)
        self.point = np.maximum(self.point - [self.speed, 0.0], 0.0)
        if not isinstance(command, str):
            self.joints.newest = self.joints.newest + command
            self.frame.positions = self.joints.newest

    def find_again(self):
        self.found.append(len(self.steps))
        return False


class Arrival:
    """Settled after so many frames within a distance."""

    def __init__(self, within=2.0, frames=3, close_from=0):
        self.tolerance, self.frames, self.close_from, self.given = within, frames, close_from, []
        self.seen, self.settled, self.close = 0, False, True

    def observe(self, distance, *, blind=False):
        self.given.append((distance, blind))
        self.seen = self.seen + 1 if distance <= self.tolerance and not blind else 0
        self.settled, self.close = self.seen >= self.frames, self.seen >= self.close_from


def point_tracker(lost=False):
    tracker = object.__new__(PointTracker)
    tracker.tracks = SimpleNamespace(lost=SimpleNamespace(numpy=lambda: np.array([[tracker.gone]])))
    tracker._batched, tracker.device, tracker.gone = False, SimpleNamespace(is_cpu=True), lost
    return tracker


def body_tracker(postures=(), by_chain=((0.0, 0.0), (0.0, 0.0))):
    """One whose planned postures are given, and the point's J [px/rad] by its chain."""
    tracker = object.__new__(BodyTracker)
    tracker.unseen, tracker.uncertainty, tracker.lately, asked, postures = 0, 0.7, [0.7], [], list(postures)
    tracker.features = SimpleNamespace(jacobian=lambda feature, at: np.array(by_chain))

    def posture_for(target, positions, limits, *, held, start):
        asked.append((target, positions.copy(), limits, held, start))
        return postures.pop(0) if postures else None

    tracker.on_link = SimpleNamespace(posture_for=posture_for)
    return tracker, asked
