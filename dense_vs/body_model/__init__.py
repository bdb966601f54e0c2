"""A body learned without markers: links, axes and surface from tracks, known at every posture, seen or hidden.

Where its motion does not tell the joints apart, as in reaches, J is remembered by posture instead.

May import: the ground and :mod:`dense_vs.generative`, whose least squares and rotations it uses.
"""

from dense_vs.body_model.fit import FitOptions
from dense_vs.body_model.keyframes import Keyframes, MemoryOptions
from dense_vs.body_model.load_body import load_body
from dense_vs.body_model.model import BodyImage, BodyModel, BodyPoints
from dense_vs.body_model.posture_memory import MemoryFit, PostureMemory
from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.body_model.tracks import PointTracks, TrackOptions, follow_points

__all__ = [
    "BodyImage",
    "BodyModel",
    "BodyPoints",
    "FitOptions",
    "Keyframes",
    "MemoryFit",
    "MemoryOptions",
    "PointTracks",
    "PostureMemory",
    "SurfaceOptions",
    "TrackOptions",
    "follow_points",
    "load_body",
]
