"""Dense visual servoing without calibration.

Learn, while a robot moves, how every pixel of its camera image answers to every joint, and bring any point of
its body where it should be in the image. Names are imported when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dense_vs.babbling import Babbling as Babbling
    from dense_vs.batch_flow import BatchFlow as BatchFlow
    from dense_vs.broyden import HadamardBroyden as HadamardBroyden
    from dense_vs.depth_approach import DepthApproach as DepthApproach
    from dense_vs.errors import DenseVSError as DenseVSError
    from dense_vs.feature_servo import FeatureServo as FeatureServo
    from dense_vs.flow import FlowEstimator as FlowEstimator
    from dense_vs.grasp_loop import GraspLoop as GraspLoop
    from dense_vs.jacobian import DenseJacobian as DenseJacobian
    from dense_vs.joint_log import JointLog as JointLog
    from dense_vs.mask_servo import MaskServo as MaskServo
    from dense_vs.pipeline import FramePipeline as FramePipeline
    from dense_vs.robot import Camera as Camera
    from dense_vs.robot import Robot as Robot
    from dense_vs.self_body import SelfBody as SelfBody
    from dense_vs.servo import VisualServo as VisualServo
    from dense_vs.servo_loop import ServoLoop as ServoLoop
    from dense_vs.tracker import PointTracker as PointTracker

_HOMES = {
    "Babbling": "babbling",
    "BatchFlow": "batch_flow",
    "Camera": "robot",
    "DenseJacobian": "jacobian",
    "DenseVSError": "errors",
    "DepthApproach": "depth_approach",
    "FeatureServo": "feature_servo",
    "FlowEstimator": "flow",
    "FramePipeline": "pipeline",
    "GraspLoop": "grasp_loop",
    "HadamardBroyden": "broyden",
    "JointLog": "joint_log",
    "MaskServo": "mask_servo",
    "PointTracker": "tracker",
    "Robot": "robot",
    "SelfBody": "self_body",
    "ServoLoop": "servo_loop",
    "VisualServo": "servo",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'dense_vs' has no attribute {name!r}")
    return getattr(import_module(f"dense_vs.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_HOMES)
