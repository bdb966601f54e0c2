"""Which pixels are the robot's own body: DIJE's Algorithms 1 and 2, and evidence from motion and color.

May import: the ground, kernels and :mod:`dense_vs.jacobian`.
"""

from dense_vs.body.motion_evidence import SelfMotionOptions
from dense_vs.body.self_body import SelfBody

__all__ = ["SelfBody", "SelfMotionOptions"]
