"""Evidence on the distance from the views of an approach, and the estimate with its uncertainty made from it.

The object's region is followed through the views by perspective; views in which the image border cuts it are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.depth.area_fit import check_motion
from dense_vs.depth.region_shape import RegionShape
from dense_vs.depth.region_track import follow_region
from dense_vs.depth.scale_posterior import DistancePosterior, ScaleModel, distance_posterior

OBSERVABLE_LOG_STD = 0.5
OBSERVABLE_GROWTH = 3.0  # px


@dataclass(frozen=True)
class MaskDepth:
    """How far an object is.

    Attributes:
        distance: from the nearest of all views to the object [m]. ``"vos-de"`` gives what VOS-VS (20) gives, which
            noise can make negative; ``observable`` is False then.
        interval: (low, high) [m], holds the distance with a probability of about 68 %.
        log_std: standard deviation of the distance's logarithm; about the relative error to expect.
        observable: whether the views tell the distance at all: its logarithm is known to better than 0.5, and
            the object grows by at least three pixels, which rounding cannot explain. Where not, ``distance`` is little
            more than a guess from the camera's travel.
        used: ``(m,)`` bool, views that the estimate stands on.
        weight: ``(m,)``, how much each view counts, from 0 (left out) to 1.
        regions: of each view the object's region, None where it was not found.
        method: that was used.
    """

    distance: float
    interval: tuple[float, float]
    log_std: float
    observable: bool
    used: np.ndarray
    weight: np.ndarray
    regions: tuple[RegionShape | None, ...]
    method: str


@dataclass(frozen=True)
class Evidence:
    """The object in the views.

    Attributes:
        shapes: the object in the views that are used, nearest first.
        camera_back: ``(n,)`` [m] of those views, from the nearest of them.
        order: ``(n,)`` their indices among all views.
        image_size: height, width [px].
        nearest_offset: [m], how much nearer the nearest of all views is than the nearest that is used.
        regions: of every view, in the order given.
    """

    shapes: tuple[RegionShape, ...]
    camera_back: np.ndarray
    order: np.ndarray
    image_size: tuple[int, int]
    nearest_offset: float
    regions: tuple[RegionShape | None, ...]

    def posterior(self, model: ScaleModel | None = None) -> DistancePosterior:
        """Of the distance at the nearest view that is used."""
        return distance_posterior(self.shapes, self.camera_back, self.image_size, model)

    def result(self, posterior: DistancePosterior, method: str, distance: float) -> MaskDepth:
        """``distance`` [m] from the nearest view used, as the answer for the nearest of all views."""
        used = np.zeros(len(self.regions), dtype=bool)
        used[self.order] = True
        weight = np.zeros(len(self.regions))
        weight[self.order] = posterior.view_weight
        # The camera of the nearest view is in front of the object, whatever the farther views say.
        floor = 0.05 * distance
        low, high = (max(posterior.quantile(share) - self.nearest_offset, floor) for share in (0.16, 0.84))
        at_nearest = max(distance - self.nearest_offset, floor)
        log_std = posterior.log_std() * distance / at_nearest
        travel = float(np.ptp(self.camera_back))
        growth = float(self.shapes[0].widths.max()) * travel / (distance + travel)
        observable = log_std < OBSERVABLE_LOG_STD and growth >= OBSERVABLE_GROWTH
        return MaskDepth(at_nearest, (low, high), log_std, observable, used, weight, self.regions, method)


def gather_evidence(
    views: Sequence[Sequence[RegionShape]], camera_back: np.ndarray, image_size: tuple[int, int]
) -> Evidence:
    """Follow the object through the views and keep those that tell its size.

    Raises:
        DepthUnobservableError: fewer than two such views, or all from one position.
    """
    ascending = np.argsort(camera_back, kind="stable")
    back = camera_back[ascending] - camera_back.min()
    followed = follow_region([views[index] for index in ascending], back, image_size)
    found = [k for k, region in enumerate(followed) if region is not None]
    whole = [k for k in found if not _cut(followed[k])]
    # A region that the border cuts is too small, but two views are too few to know anything.
    kept = whole if len(whole) >= 3 and np.ptp(back[whole]) > 0 else found
    check_motion(back[kept])
    regions: list[RegionShape | None] = [None] * len(views)
    for k, region in enumerate(followed):
        regions[ascending[k]] = region
    shapes = tuple(region for region in (followed[k] for k in kept) if region is not None)
    near = back[kept[0]]
    return Evidence(shapes, back[kept] - near, ascending[kept], image_size, float(near), tuple(regions))


def _cut(region: RegionShape | None) -> bool:
    return region is None or region.touches_border
