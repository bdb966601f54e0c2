"""How far an object is, from its masks in the views of a camera that approaches it: VOS-DE, and more robust kin."""

from dense_vs.depth.area_fit import DepthEstimate as DepthEstimate
from dense_vs.depth.area_fit import DepthUnobservableError as DepthUnobservableError
from dense_vs.depth.area_fit import depth_from_areas as depth_from_areas
