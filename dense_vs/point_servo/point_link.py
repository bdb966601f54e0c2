"""Which link of a body a point in the image is on: by the J that was learned there and by the model's surface.

A few pixels of a point's own track fit many links, above all where many joints move it. J at the point has zero columns
for the joints after its link, and of what the chain's joints can do to a pixel only the depth is open: one number for
each link, in which J is linear by the inverse.
"""

import numpy as np

from dense_vs.body_model import BodyModel
from dense_vs.point_servo.surface_place import SurfacePlace

LEAST_INVERSE = 1e-3  # of the depth's inverse: what is seen is before the camera
MOST_LEFT = 0.5  # share of J that the best link may leave, for J to say which it is
AS_GOOD = 1.25  # times that share, up to which the surface's link is as good


def link_of_point(
    model: BodyModel, jacobian: np.ndarray, positions: np.ndarray, point: np.ndarray, surface: SurfacePlace | None
) -> int | None:
    """Link that a point is on; None where neither J nor the surface tells.

    Args:
        model: of the body.
        jacobian: ``(2, N)`` [px/rad] at the point, as it was learned.
        positions: joint positions ``(N,)`` [rad].
        point: ``(2,)`` [px].
        surface: of the model there; None where it has none.
    """
    left = left_by_links(model, jacobian, positions, point)
    best = min(left, key=left.__getitem__, default=None)
    if best is None or not left[best] <= MOST_LEFT:
        return None if surface is None else surface.link
    if surface is not None and left.get(surface.link, np.inf) <= AS_GOOD * left[best]:
        return surface.link
    return best


def left_by_links(model: BodyModel, jacobian: np.ndarray, positions: np.ndarray, point: np.ndarray) -> dict[int, float]:
    """Share of J at a point that each link's motion leaves unexplained, at the depth that explains most.

    Arguments as of :func:`link_of_point`; without links where nothing moves there.
    """
    chain, learned = model.chain, model.learned
    J = jacobian * learned
    size = float(np.linalg.norm(J))
    if not np.isfinite(size) or size == 0:
        return {}
    axes, moments = chain.screws(positions)
    ray = model.rays(point[None])[0]

    def seen(velocity: np.ndarray) -> np.ndarray:
        """Motion in the image ``(2, N)`` of what moves so ``(N, 3)`` at depth 1."""
        return model.focal_length * (velocity[:, :2] - ray[:2] * velocity[:, 2:]).T

    turns, shifts = seen(np.cross(axes, ray)), seen(moments)
    left = {}
    for link in np.flatnonzero(learned):
        moved = chain.moved_by[link] & learned
        turn, shift = turns * moved, shifts * moved
        inverse = float(np.sum(shift * (J - turn)) / max(float(np.sum(shift**2)), 1e-12))
        left[int(link)] = float(np.linalg.norm(turn + max(inverse, LEAST_INVERSE) * shift - J)) / size
    return left
