"""Shape of a mask's regions, as lengths that scale with the inverse of the distance.

Of every connected region: area and centroid, VOS-VS (3), VOS-VS (4), VOS-VS (5); second moments; its support function,
the farthest that it reaches in each of 16 directions, whose opposite pairs are its widths (the bounding box is four of
them); the length of its outline; and whether it touches the image border.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.arrays import plain_array
from dense_vs.errors import DenseVSError
from dense_vs.kernels.masks.region_sums import RegionSums
from dense_vs.segmentation.mask_features import connected_regions

DIRECTIONS = 16
MAX_REGIONS = 24  # of a view, the largest
_angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
_unit = np.stack([np.cos(_angles), np.sin(_angles)])  # (2, D)
# A pixel is a square about its center: it reaches this much farther than its center.
_half_pixel = 0.5 * np.abs(_unit).sum(axis=0)
WIDTH_AXES = _unit[:, : DIRECTIONS // 2]


@dataclass(frozen=True)
class RegionShape:
    """A region, or several taken together.

    Attributes:
        area: [px].
        centroid: ``(2,)`` x, y [px].
        moments: ``(2, 2)`` central second moments over the area [px^2].
        support: ``(16,)`` [px], the farthest coordinate along each direction from the image's origin.
        outline: length [px].
        touches_border: whether a pixel lies on the border of the image.
    """

    area: float
    centroid: np.ndarray
    moments: np.ndarray
    support: np.ndarray
    outline: float
    touches_border: bool

    @property
    def widths(self) -> np.ndarray:
        """``(8,)`` [px], the extent along each axis of :data:`WIDTH_AXES`."""
        half = DIRECTIONS // 2
        return self.support[:half] + self.support[half:]


def mask_regions(masks: Any) -> list[list[RegionShape]]:
    """The regions of each view, largest first; an empty list where a mask is empty.

    Args:
        masks: ``(m, H, W)``, anything but 0 belongs to the object.

    Raises:
        DenseVSError: another number of dimensions, or values that are not numbers or truth values.
    """
    return [_regions(mask) for mask in checked_masks(masks)]


def checked_masks(masks: Any) -> np.ndarray:
    """Masks as bool ``(m, H, W)``."""
    array = plain_array(masks, "masks", "binary masks of shape (m, H, W)")
    if array.ndim != 3 or array.dtype.kind not in "buif" or 0 in array.shape[1:]:
        raise DenseVSError(
            f"masks have shape {array.shape} and dtype {array.dtype}; expected binary masks of shape (m, H, W)"
        )
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise DenseVSError("masks hold values that are not finite; expected 0 and 1")
    return array != 0


def joined(regions: Sequence[RegionShape]) -> RegionShape:
    """Several regions as one: what is left of an object whose mask is split."""
    if len(regions) == 1:
        return regions[0]
    areas = np.array([region.area for region in regions])
    centroids = np.array([region.centroid for region in regions])
    area = areas.sum()
    centroid = areas @ centroids / area
    apart = centroids - centroid
    moments = sum(a * (r.moments + np.outer(d, d)) for a, r, d in zip(areas, regions, apart, strict=True)) / area
    return RegionShape(
        float(area),
        centroid,
        np.asarray(moments),
        np.max([region.support for region in regions], axis=0),
        float(sum(region.outline for region in regions)),
        any(region.touches_border for region in regions),
    )


def _regions(mask: np.ndarray) -> list[RegionShape]:
    labels, found = connected_regions(mask)
    order = np.argsort(-found.area, kind="stable")[:MAX_REGIONS]
    return [_region(labels, int(k) + 1, found[k]) for k in order]


def _region(labels: np.ndarray, label: int, found: RegionSums) -> RegionShape:
    x, y, width, height = found.box.tolist()
    inside = (labels[y : y + height, x : x + width] == label).view(np.uint8)
    outlines, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x, y))
    points = np.concatenate([outline[:, 0] for outline in outlines]).astype(np.float64)
    xx, yy, xy = found.moments.tolist()
    return RegionShape(
        float(found.area),
        found.centroid,
        # The 1/12 is a pixel's own second moment: it is a square, not a point.
        np.array([[xx + 1 / 12, xy], [xy, yy + 1 / 12]]),
        (points @ _unit).max(axis=0) + _half_pixel,
        float(len(points)),
        bool(found.border),
    )
