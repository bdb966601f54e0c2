"""A frame through flow, Jacobian and labels; a whole recording, frame by frame.

May import: the ground, :mod:`dense_vs.health`, :mod:`dense_vs.recording`, :mod:`dense_vs.flow`,
:mod:`dense_vs.jacobian` and :mod:`dense_vs.body`.
"""

from dense_vs.pipeline.body_prior import BodyPrior
from dense_vs.pipeline.explained_motion import ExplainedMotion
from dense_vs.pipeline.frame_pipeline import FramePipeline, ProcessedFrame, scaled_size
from dense_vs.pipeline.recorded import RecordedEstimate, estimate_recording

__all__ = [
    "BodyPrior",
    "ExplainedMotion",
    "FramePipeline",
    "ProcessedFrame",
    "RecordedEstimate",
    "estimate_recording",
    "scaled_size",
]
