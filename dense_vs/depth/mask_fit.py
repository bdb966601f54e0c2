"""An object's distance from raw binary masks of an approach: VOS-DE on masks as segmenters really deliver them.

``"vos-de"`` is the paper: VOS-VS (20) on the area of the largest region of each view. ``"robust"``, beyond the paper,
follows the object's region by perspective (``region_track.py``), leaves out views in which the image border cuts it,
and weighs all its lengths by how they err together (``scale_posterior.py``). ``"learned"`` corrects the robust
posterior by a small network that was trained on simulated masks (``learned_depth.py``).
"""

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np

from dense_vs.checks import check_choice, check_pair, is_list, shown
from dense_vs.depth.area_fit import check_motion, checked_positions, depth_from_areas
from dense_vs.depth.evidence import OBSERVABLE_LOG_STD, MaskDepth, gather_evidence
from dense_vs.depth.learned_depth import LearnedDepth
from dense_vs.depth.region_shape import RegionShape, checked_masks, mask_regions
from dense_vs.errors import DenseVSError

Method = Literal["vos-de", "robust", "learned"]
METHODS: tuple[str, ...] = get_args(Method)
LARGEST_SIDE = 1 << 14  # px


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
    """As :func:`depth_from_masks`, from the regions that :func:`mask_regions` found.

    Args:
        views: of each view its regions, the largest first.
        camera_back, method: as of :func:`depth_from_masks`.
        image_size: (H, W) [px].

    Raises:
        DepthUnobservableError: as :func:`depth_from_masks`.
        DenseVSError: no regions, no size, or as :func:`depth_from_masks`.
    """
    check_choice("method", method, METHODS)
    image_size = check_pair("image_size", image_size, least=1, most=LARGEST_SIDE)
    if not is_list(views) or not all(is_list(ones) and all(isinstance(r, RegionShape) for r in ones) for ones in views):
        raise DenseVSError(f"views are {shown(views)}; expected a list of regions for each view, as of mask_regions")
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
    return LearnedDepth.shipped()(gather_evidence(views, back, image_size))


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
