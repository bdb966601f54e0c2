"""Where a body model has its surface about a pixel, and how that goes with what the model leaves open."""

from dataclasses import dataclass

import numpy as np

from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.model import BodyImage
from dense_vs.body_model.precision import Precision

BESIDE = 2  # px by which the model's outline may be off
ABOUT = 5  # px about the place, in which its relief is measured


@dataclass(frozen=True)
class SurfacePlace:
    """A place on the surface.

    Attributes:
        link: that it is on.
        depth: in the chain's unit.
        steps: ``(R, 4 N + 1)`` of one standard deviation each of lines and focal length, see :attr:`.Precision.lines`,
            and ``(R,)`` by which the logarithm of the depth follows each of them; None where the model has none.
        relief: standard deviation of the logarithm of the link's depths within :data:`ABOUT`.
    """

    link: int
    depth: float
    steps: tuple[np.ndarray, np.ndarray] | None = None
    relief: float = 0.0


def surface_at(seen: BodyImage, point: np.ndarray, precision: Precision | None = None) -> SurfacePlace | None:
    """Link and depth of a body at and around a place, those of most pixels; None where it is not.

    Args:
        seen: the body in a posture.
        point: ``(2,)`` [px].
        precision: of the body.
    """
    row, column = (round(float(at)) for at in point[::-1])
    rows, columns = (slice(max(0, at - BESIDE), at + BESIDE + 1) for at in (row, column))
    links, depths = seen.links[rows, columns], seen.depths[rows, columns]
    on = links != BACKGROUND
    if not on.any():
        return None
    link = int(np.bincount(links[on]).argmax())
    depth = float(np.median(depths[links == link]))
    away = np.hypot(*np.ogrid[-row : seen.links.shape[0] - row, -column : seen.links.shape[1] - column])
    relief = float(np.log(seen.depths[(away <= ABOUT) & (seen.links == link)]).std())
    if precision is None:
        return SurfacePlace(link, depth, relief=relief)
    there = seen.points[rows, columns][links == link]
    return SurfacePlace(link, depth, (precision.lines, precision.depth_steps[there].mean(axis=0)), relief)
