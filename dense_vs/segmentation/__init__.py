"""Masks from images: VOS-VS section 4.1, with a segmenter of one's choice and what to think of its masks."""

from dense_vs.segmentation.annotated_folder import AnnotatedFolder, read_image, read_images, read_mask, write_mask
from dense_vs.segmentation.few_shot.segmenter import FewShotOptions, FewShotSegmenter
from dense_vs.segmentation.mask_quality import MaskQuality, MaskVerdict, assess_mask
from dense_vs.segmentation.onnx_segmenter import OnnxOptions, OnnxSegmenter
from dense_vs.segmentation.segmenter import Segmenter

__all__ = [
    "AnnotatedFolder",
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
