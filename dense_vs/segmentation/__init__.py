"""Masks from images, VOS-VS section 4.1: segmenters, the figures of a mask, and whether a mask can be trusted.

May import: the ground and kernels.
"""

from dense_vs.segmentation.annotated_folder import AnnotatedFolder, read_image, read_images, read_mask, write_mask
from dense_vs.segmentation.few_shot.object_track import Doubt
from dense_vs.segmentation.few_shot.segmenter import FewShotOptions, FewShotSegmenter
from dense_vs.segmentation.mask_quality import MaskQuality, MaskVerdict, assess_mask
from dense_vs.segmentation.onnx_segmenter import OnnxOptions, OnnxSegmenter
from dense_vs.segmentation.segmenter import Segmenter

__all__ = [
    "AnnotatedFolder",
    "Doubt",
    "FewShotOptions",
    "FewShotSegmenter",
    "MaskQuality",
    "MaskVerdict",
    "OnnxOptions",
    "OnnxSegmenter",
    "Segmenter",
    "assess_mask",
    "read_image",
    "read_images",
    "read_mask",
    "write_mask",
]
