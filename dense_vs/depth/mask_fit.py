"""An object's distance from raw binary masks of an approach: VOS-DE on masks as segmenters really deliver them.

``"vos-de"`` is the paper: the largest region of each view, (20) on its area. ``"robust"``, beyond the paper, follows
the object's region by perspective (``region_track.py``), leaves out views in which the image border cuts it, and
weighs all its lengths by how they err together (``scale_posterior.py``). ``"learned"`` corrects the robust posterior
by a small network that was trained on simulated masks (``learned_depth.py``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from dense_vs.depth.area_fit import check_motion, checked_positions, depth_from_areas
from dense_vs.depth.region_shape import RegionShape, checked_masks, mask_regions
from dense_vs.depth.region_track import follow_region
from dense_vs.depth.scale_posterior import DistancePosterior, ScaleModel, distance_posterior
from dense_vs.errors import DenseVSError

Method = Literal["vos-de", "robust", "learned"]
METHODS: tuple[str, ...] = get_args(Method)
OBSERVABLE_LOG_STD = 0.5
OBSERVABLE_GROWTH = 3.0  # px


@dataclass(frozen=True)
class MaskDepth:
    """How far an object is.

    Attributes:
        distance: from the nearest of all views to the object [m]. ``"vos-de"`` gives what (20) gives, which noise can
            make negative; ``observable`` is False then.
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


def depth_from_masks(masks: Any, camera_back: Any, method: Method = "robust") -> MaskDepth:
    """The distance from the nearest view to the object.

    Args:
        masks: ``(m, H, W)``, anything but 0 belongs to the object; views in any order, empty masks allowed.
        camera_back: ``(m,)`` [m], how far the camera stands behind any fixed position, along its optical axis.
        method: see the module's docstring.

    Raises:
        DepthUnobservableError: fewer than two views show the object, or the camera does not move between them.
        DenseVSError: another shape, values that are not finite, an unknown method.
    """
    masks = checked_masks(masks)
    return depth_from_regions(mask_regions(masks), camera_back, (masks.shape[1], masks.shape[2]), method)


def depth_from_regions(
    views: Sequence[Sequence[RegionShape]],
    camera_back: Any,
    image_size: tuple[int, int],
    method: Method = "robust",
) -> MaskDepth:
    """As :func:`depth_from_masks`, from the regions that :func:`mask_regions` found; ``image_size`` is (H, W)."""
    if method not in METHODS:
        raise DenseVSError(f"method is {method!r}; expected one of {', '.join(METHODS)}")
    back = checked_positions(camera_back, "camera_back")
    if len(back) != len(views):
        raise DenseVSError(f"there are {len(views)} masks and {len(back)} values of camera_back; expected as many")
    check_motion(back[[bool(regions) for regions in views]])
    if method == "vos-de":
        return _largest_region(views, back)
    if method == "robust":
        evidence = gather_evidence(views, back, image_size)
        posterior = evidence.posterior()
        return evidence.result(posterior, "robust", posterior.least_relative_error())
    from dense_vs.depth.learned_depth import LearnedDepth

    return LearnedDepth.shipped()(gather_evidence(views, back, image_size))


@dataclass(frozen=True)
class Evidence:
    """What the views show of the object.

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


def _largest_region(views: Sequence[Sequence[RegionShape]], back: np.ndarray) -> MaskDepth:
    areas = np.array([regions[0].area if regions else 0.0 for regions in views])
    fit = depth_from_areas(areas, back - back.min(), keep_empty=True)
    # With z_camera = camera_back, the object lies at -distance; views without the object may be nearer than any used.
    distance = -fit.z_object
    spread = fit.distance_std
    log_std = spread / distance if distance > 0.0 else float("inf")
    interval = (max(distance - spread, 0.0), max(distance + spread, 0.0))
    observable = bool(log_std < OBSERVABLE_LOG_STD)
    regions = tuple(regions[0] if regions else None for regions in views)
    return MaskDepth(
        distance, interval, float(log_std), observable, fit.used, fit.used.astype(float), regions, "vos-de"
    )
