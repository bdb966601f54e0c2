"""Which region of each view is the object: beyond VOS-VS, which takes the largest.

In clutter the largest region is often another one, and another one in the next view. A standing object seen by a
camera that approaches along its optical axis can only be where perspective puts it: at distance z, a view taken b
behind the nearest one shows it smaller by s = z / (z + b) and nearer to the image center by as much. Every large
region of the nearest views is followed so for a range of distances; kept is what is found again best, is large, and
stands near the image center, where visual servoing has brought the object.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_vs.depth.region_shape import DIRECTIONS, RegionShape, joined

# Distances tried, as multiples of the camera's travel.
_distances = np.exp(np.linspace(np.log(0.08), np.log(8.0), 25))


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """How far a region may be from where perspective puts it.

    Attributes:
        log_size: spread of the logarithm of the size.
        position: spread of the center, as a share of the region's size.
        axis: spread of the image point that the camera moves toward, as a share of the image width: the optical
            axis is not calibrated.
        missing: the cost, in squared spreads, from which a view counts as not showing the region.
        center: spread of the object's distance from the image center, as a share of the image width.
        size_weight: reward for a region's log size.
        seeds, seed_views: regions tried of each of so many nearest views.
        seed_share: least area of a seed, as a share of the largest region of its view.
    """

    log_size: float = 0.15
    position: float = 0.25
    axis: float = 0.04
    missing: float = 9.0
    center: float = 0.2
    size_weight: float = 2.0
    seeds: int = 6
    seed_views: int = 3
    seed_share: float = 0.05


def follow_region(
    views: Sequence[Sequence[RegionShape]],
    camera_back: np.ndarray,
    image_size: tuple[int, int],
    options: TrackOptions | None = None,
) -> list[RegionShape | None]:
    """The object's region in each view, None where it is not found; fragments of a split mask are joined.

    Args:
        views: the regions of each view, nearest view first.
        camera_back: ``(m,)`` [m], from the nearest position, ascending.
        image_size: height, width [px].
    """
    options = options or TrackOptions()
    seen = [index for index, regions in enumerate(views) if regions]
    if not seen:
        return [None] * len(views)
    travel = float(np.ptp(camera_back))
    if travel <= 0.0:
        return [regions[0] if regions else None for regions in views]
    tables = [_Table(regions) for regions in views]
    center = 0.5 * np.array([image_size[1] - 1, image_size[0] - 1])
    best: tuple[float, int, RegionShape, float, np.ndarray] | None = None
    for start in seen[: options.seed_views]:
        for region in views[start][: options.seeds]:
            if region.area < options.seed_share * views[start][0].area:
                break
            z = _distances * travel
            scale = (z + camera_back[start])[:, None] / (z[:, None] + camera_back)
            costs = [
                table.costs(region, scale[:, view], center, image_size[1], options) for view, table in enumerate(tables)
            ]
            found = np.stack([cost.min(axis=1, initial=options.missing) for cost in costs], axis=1)
            k = int(found.sum(axis=1).argmin())
            size = 0.5 * np.log(region.area) + np.log(scale[k, seen[0]])
            off = np.linalg.norm(region.centroid - center) / (options.center * image_size[1])
            score = -0.5 * found[k].sum() + options.size_weight * size - 0.5 * off**2
            if best is None or score > best[0]:
                chosen = np.array([c[k].argmin() if c.shape[1] and c[k].min() < options.missing else -1 for c in costs])
                best = (float(score), start, region, float(z[k]), chosen)
    assert best is not None  # a view that shows something has a seed
    _, start, region, z, chosen = best
    scale = (z + camera_back[start]) / (z + camera_back)
    return [_with_fragments(views[view], int(chosen[view]), region, scale[view], center) for view in range(len(views))]


class _Table:
    """A view's regions as arrays."""

    def __init__(self, regions: Sequence[RegionShape]):
        self.log_size = 0.5 * np.log([region.area for region in regions]) if regions else np.zeros(0)
        self.centroid = np.array([region.centroid for region in regions]).reshape(-1, 2)
        self.border = np.array([region.touches_border for region in regions], dtype=bool)

    def costs(
        self, seed: RegionShape, scale: np.ndarray, center: np.ndarray, width: int, options: TrackOptions
    ) -> np.ndarray:
        """``(distances, regions)``, squared spreads between each region and where the seed should be."""
        size = np.sqrt(seed.area) * scale
        place = center + scale[:, None] * (seed.centroid - center)
        off_size = (self.log_size - np.log(size)[:, None]) / (options.log_size + 1.0 / size[:, None])
        spread = options.position * size + options.axis * width * np.abs(1.0 - scale) + 1.0
        off_place = np.linalg.norm(self.centroid - place[:, None], axis=2) / spread[:, None]
        # A region that is cut off by the border tells little, but it is more likely there than not found.
        return off_size**2 + off_place**2 + 0.3 * options.missing * self.border


def _with_fragments(
    regions: Sequence[RegionShape], chosen: int, seed: RegionShape, scale: float, center: np.ndarray
) -> RegionShape | None:
    """The chosen region together with those that lie within the seed's outline at this scale."""
    if chosen < 0:
        return None
    half = DIRECTIONS // 2
    main = regions[chosen]
    # The seed's widths about the middle of the region that was found.
    middle = 0.5 * (main.support[:half] - main.support[half:])
    reach = 0.5 * scale * seed.widths
    parts = [main]
    for index, other in enumerate(regions):
        if index == chosen:
            continue
        most, least = other.support[:half], -other.support[half:]
        if (most <= middle + reach + 1.0).all() and (least >= middle - reach - 1.0).all():
            parts.append(other)
    return joined(parts)
