"""Bringing a point of the robot's body to a place in the image: tracker DIJE (15), law DIJE (17), and their loop.

May import: the ground, kernels, :mod:`dense_vs.robot`, :mod:`dense_vs.health`, :mod:`dense_vs.recording`,
:mod:`dense_vs.flow`, :mod:`dense_vs.jacobian`, :mod:`dense_vs.body`, :mod:`dense_vs.body_model` and
:mod:`dense_vs.pipeline`.
"""

from dense_vs.point_servo.body_tracker import BodyTracker
from dense_vs.point_servo.checkpoint import Checkpoint
from dense_vs.point_servo.law import VisualServo
from dense_vs.point_servo.loop import ServoLoop
from dense_vs.point_servo.reach import Reach, ReachEnd
from dense_vs.point_servo.tracker import PointTracker

__all__ = ["BodyTracker", "Checkpoint", "PointTracker", "Reach", "ReachEnd", "ServoLoop", "VisualServo"]
