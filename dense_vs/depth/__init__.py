"""How far an object is, from its masks in the views of an approaching camera: VOS-DE, and more robust methods.

May import: the ground, :mod:`dense_vs.robot` and :mod:`dense_vs.segmentation`.
"""

from dense_vs.depth.area_fit import DepthEstimate as DepthEstimate
from dense_vs.depth.area_fit import DepthUnobservableError as DepthUnobservableError
from dense_vs.depth.area_fit import depth_from_areas as depth_from_areas
from dense_vs.depth.evidence import MaskDepth as MaskDepth
from dense_vs.depth.mask_fit import METHODS as METHODS
from dense_vs.depth.mask_fit import depth_from_masks as depth_from_masks
from dense_vs.depth.mask_fit import depth_from_regions as depth_from_regions
from dense_vs.depth.region_shape import mask_regions as mask_regions
