"""The interfaces to a robot: its camera, joints and gripper, and the motion by which it learns.

May import: the ground (``errors``, ``arrays``, ``device``, ``files``) and kernels.
"""

from dense_vs.robot.babbling import Babbling, BabblingOptions
from dense_vs.robot.protocols import Camera, Robot

__all__ = ["Babbling", "BabblingOptions", "Camera", "Robot"]
