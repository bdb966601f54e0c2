"""A segmenter that learns an object from some ten annotated images: regions, features, a forest, refined masks.

May import: the ground, kernels and the interface :mod:`dense_vs.segmentation.segmenter`.
"""

from dense_vs.segmentation.few_shot.object_track import Doubt
from dense_vs.segmentation.few_shot.segmenter import FewShotOptions, FewShotSegmenter

__all__ = ["Doubt", "FewShotOptions", "FewShotSegmenter"]
