"""A body learned without markers: links, axes and surface from tracks, known at every posture, seen or hidden.

May import: the ground and :mod:`dense_vs.generative`, whose least squares and rotations it uses.
"""

from dense_vs.body_model.fit import FitOptions
from dense_vs.body_model.model import BodyImage, BodyModel, BodyPoints
from dense_vs.body_model.surface import SurfaceOptions
from dense_vs.body_model.tracks import PointTracks, TrackOptions, follow_points

__all__ = [
    "BodyImage",
    "BodyModel",
    "BodyPoints",
    "FitOptions",
    "PointTracks",
    "SurfaceOptions",
    "TrackOptions",
    "follow_points",
]
