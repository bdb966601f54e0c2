"""Judges images and joint readings before anything is learned from them or done by them, and names what is wrong.

May import: the ground, kernels and :mod:`dense_vs.robot`.
"""

from dense_vs.health.faults import Fault, FaultKind
from dense_vs.health.image_watch import ImageWatch
from dense_vs.health.joint_watch import JointWatch

__all__ = ["Fault", "FaultKind", "ImageWatch", "JointWatch"]
