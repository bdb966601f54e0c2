"""Grasping from masks, VOS-Grasp: where to stop, VOS-VS (21), how to turn the wrist,
VOS-VS (22), and whether the hand holds the object, VOS-VS (23).

May import: the ground, :mod:`dense_vs.robot`, :mod:`dense_vs.segmentation` and :mod:`dense_vs.mask_servo`.
"""

from dense_vs.grasp.camera_height import grasp_camera_position
from dense_vs.grasp.grasp_check import GraspCheck, GraspOutcome, check_grasp
from dense_vs.grasp.gripper_mask import GripperModel
from dense_vs.grasp.hand_geometry import HandGeometry
from dense_vs.grasp.loop import GraspAttempt, GraspLoop, GraspRun
from dense_vs.grasp.regrasp import GraspAction, GraspStep, RegraspPolicy
from dense_vs.grasp.wrist_angle import WristChoice, WristVerdict, choose_wrist_angle, intersection_over_union

__all__ = [
    "GraspAction",
    "GraspAttempt",
    "GraspCheck",
    "GraspLoop",
    "GraspOutcome",
    "GraspRun",
    "GraspStep",
    "GripperModel",
    "HandGeometry",
    "RegraspPolicy",
    "WristChoice",
    "WristVerdict",
    "check_grasp",
    "choose_wrist_angle",
    "grasp_camera_position",
    "intersection_over_union",
]
