"""A body learned without markers: links, axes and surface from tracks, known at every posture, seen or hidden.

Where its motion does not tell the joints apart, as in reaches, J is remembered by posture instead.

May import: the ground, :mod:`dense_vs.generative`, whose least squares and rotations it uses, and
:mod:`dense_vs.flow`, which tells a swaying camera.
"""

from dense_vs.body_model.body_change import BodyChange, ChangeKind
from dense_vs.body_model.body_views import BodyImage, BodyPoints
from dense_vs.body_model.find_change import find_change
from dense_vs.body_model.fit import BodyFitOptions
from dense_vs.body_model.keyframes import Keyframes, MemoryOptions
from dense_vs.body_model.load_body import load_body
from dense_vs.body_model.model import BodyModel
from dense_vs.body_model.posture_memory import MemoryFit, PostureMemory
from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.body_model.tracks import PointTrackOptions, PointTracks, follow_points

__all__ = [
    "BodyChange",
    "BodyFitOptions",
    "BodyImage",
    "BodyModel",
    "BodyPoints",
    "ChangeKind",
    "Keyframes",
    "MemoryFit",
    "MemoryOptions",
    "PointTrackOptions",
    "PointTracks",
    "PostureMemory",
    "SurfaceOptions",
    "find_change",
    "follow_points",
    "load_body",
]
