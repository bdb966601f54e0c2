"""Centering an object by its mask, VOS-VS sections 4.1 to 4.3: law, learned J+, trust region, and their loop.

May import: the ground, :mod:`dense_vs.robot` and :mod:`dense_vs.segmentation`.
"""

from dense_vs.mask_servo.featurewise_broyden import FeaturewiseBroyden
from dense_vs.mask_servo.hadamard_broyden import HadamardBroyden
from dense_vs.mask_servo.law import FeatureServo
from dense_vs.mask_servo.loop import MaskServo, ServoEnd, ServoLook, ServoRun
from dense_vs.mask_servo.object_search import SearchResult, search_object
from dense_vs.mask_servo.trust_region import TrustRegion

__all__ = [
    "FeatureServo",
    "FeaturewiseBroyden",
    "HadamardBroyden",
    "MaskServo",
    "SearchResult",
    "ServoEnd",
    "ServoLook",
    "ServoRun",
    "TrustRegion",
    "search_object",
]
