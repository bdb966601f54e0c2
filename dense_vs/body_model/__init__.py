"""A body learned without markers: links, axes and surface from tracks, known at every posture, seen or hidden.

Where its motion does not tell the joints apart, as in reaches, J is remembered by posture instead.

May import: the ground and :mod:`dense_vs.generative`, whose least squares and rotations it uses.
"""

from dense_vs.body_model.fit import BodyFitOptions
from dense_vs.body_model.keyframes import Keyframes, MemoryOptions
from dense_vs.body_model.load_body import load_body
from dense_vs.body_model.model import BodyImage, BodyModel, BodyPoints
from dense_vs.body_model.posture_memory import MemoryFit, PostureMemory
from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.body_model.tracks import PointTrackOptions, PointTracks, follow_points

__all__ = [
    "BodyFitOptions",
    "BodyImage",
    "BodyModel",
    "BodyPoints",
    "Keyframes",
    "MemoryFit",
    "MemoryOptions",
    "PointTrackOptions",
    "PointTracks",
    "PostureMemory",
    "SurfaceOptions",
    "follow_points",
    "load_body",
]
