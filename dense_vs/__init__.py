"""Dense visual servoing without calibration.

Learn, while a robot moves, how every pixel of its camera image answers to every joint, and bring any point of
its body where it should be in the image. Names are imported when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from dense_vs.lazy_names import lazy_names

if TYPE_CHECKING:
    from dense_vs.body.self_body import SelfBody as SelfBody
    from dense_vs.body_model.model import BodyModel as BodyModel
    from dense_vs.depth.approach import DepthApproach as DepthApproach
    from dense_vs.errors import DenseVSError as DenseVSError
    from dense_vs.flow.batch_flow import BatchFlow as BatchFlow
    from dense_vs.flow.estimator import FlowEstimator as FlowEstimator
    from dense_vs.flow.estimator import to_gray as to_gray
    from dense_vs.grasp.loop import GraspLoop as GraspLoop
    from dense_vs.jacobian.estimator import DenseJacobian as DenseJacobian
    from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden as HadamardBroyden
    from dense_vs.mask_servo.law import FeatureServo as FeatureServo
    from dense_vs.mask_servo.loop import MaskServo as MaskServo
    from dense_vs.pipeline.frame_pipeline import FramePipeline as FramePipeline
    from dense_vs.point_servo.law import VisualServo as VisualServo
    from dense_vs.point_servo.loop import ServoLoop as ServoLoop
    from dense_vs.point_servo.tracker import PointTracker as PointTracker
    from dense_vs.recording.joint_log import JointLog as JointLog
    from dense_vs.recording.open_recording import open_recording as open_recording
    from dense_vs.robot.babbling import Babbling as Babbling
    from dense_vs.robot.protocols import Camera as Camera
    from dense_vs.robot.protocols import Robot as Robot

    __version__: str

_HOMES = {
    "Babbling": "robot.babbling",
    "BatchFlow": "flow.batch_flow",
    "BodyModel": "body_model.model",
    "Camera": "robot.protocols",
    "DenseJacobian": "jacobian.estimator",
    "DenseVSError": "errors",
    "DepthApproach": "depth.approach",
    "FeatureServo": "mask_servo.law",
    "FlowEstimator": "flow.estimator",
    "FramePipeline": "pipeline.frame_pipeline",
    "GraspLoop": "grasp.loop",
    "HadamardBroyden": "mask_servo.hadamard_broyden",
    "JointLog": "recording.joint_log",
    "MaskServo": "mask_servo.loop",
    "PointTracker": "point_servo.tracker",
    "Robot": "robot.protocols",
    "SelfBody": "body.self_body",
    "ServoLoop": "point_servo.loop",
    "VisualServo": "point_servo.law",
    "open_recording": "recording.open_recording",
    "to_gray": "flow.estimator",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]  # they come by __getattr__


_named, __dir__ = lazy_names(__name__, _HOMES)


def __getattr__(name: str) -> object:
    return import_module("importlib.metadata").version("dense-vs") if name == "__version__" else _named(name)
