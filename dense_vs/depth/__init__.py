"""How far an object is, from its masks in the views of an approaching camera: VOS-DE, and more robust methods.

May import: the ground, :mod:`dense_vs.robot` and :mod:`dense_vs.segmentation`.
"""

from dense_vs.depth.approach import Approach, ApproachEnd, DepthApproach
from dense_vs.depth.area_fit import DepthEstimate, DepthUnobservableError, depth_from_areas
from dense_vs.depth.evidence import MaskDepth
from dense_vs.depth.mask_fit import METHODS, depth_from_masks, depth_from_regions
from dense_vs.depth.region_shape import mask_regions

__all__ = [
    "METHODS",
    "Approach",
    "ApproachEnd",
    "DepthApproach",
    "DepthEstimate",
    "DepthUnobservableError",
    "MaskDepth",
    "depth_from_areas",
    "depth_from_masks",
    "depth_from_regions",
    "mask_regions",
]
