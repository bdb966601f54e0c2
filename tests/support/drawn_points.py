"""The surface image of points given by where they fall in the image."""

import numpy as np

from dense_vs.body_model.chain import Chain
from dense_vs.body_model.lens import Lens
from dense_vs.body_model.surface_image import SurfaceImage


def front_points(places, depths, size):
    """Index ``(H, W)`` of the point in front, of still points at places ``(P, 2)`` [px] and depths ``(P,)``."""
    depths = np.asarray(depths, float)
    points = np.column_stack([places * depths[:, None], depths])
    chain = Chain(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)), np.zeros(1), np.array([-1]))
    lens = Lens.of_center(np.zeros(2))
    return SurfaceImage(chain, points, np.full(len(points), -1), 1.0, lens, size).front(np.ones(1)).index
