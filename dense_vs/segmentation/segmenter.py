"""The interface of a segmenter, VOS-VS (2): M = vos(I, W), an image in, the object's binary mask out."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from dense_vs.arrays import plain_array
from dense_vs.errors import DenseVSError


@runtime_checkable
class Segmenter(Protocol):
    """Anything that finds one object in an image; nothing needs to be inherited.

    A mask may be wrong, empty or the whole image: :func:`dense_vs.segmentation.assess_mask` says which, and the
    loops ask it. A segmenter that remembers earlier images has a method ``reset()``, which forgets them.
    """

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The object's mask M, VOS-VS (2), bool ``(H, W)``, in an RGB uint8 image ``(H, W, 3)``."""
        ...


def forget_images(segmenter: Segmenter) -> None:
    """Reset a segmenter that remembers earlier images; the next one may show the object anywhere."""
    reset = getattr(segmenter, "reset", None)
    if callable(reset):
        reset()


def find_mask(segmenter: Segmenter, image: np.ndarray) -> np.ndarray:
    """The mask that a segmenter finds in an image, as bool ``(H, W)``.

    Raises:
        DenseVSError: it gives something else, or a mask of another size.
    """
    name = f"the mask of a {type(segmenter).__name__}"
    mask = check_mask(segmenter.segment(image), name)
    if isinstance(image, np.ndarray) and mask.shape != image.shape[:2]:
        raise DenseVSError(f"{name} has shape {mask.shape}; expected its image's, {image.shape[:2]}")
    return mask


def check_image(image: Any) -> np.ndarray:
    """The image, if it is RGB uint8 ``(H, W, 3)`` of at least 16 x 16 pixels.

    Raises:
        DenseVSError: anything else.
    """
    array = plain_array(image, "image", "RGB uint8 of shape (H, W, 3)")
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8 or min(array.shape[:2]) < 16:
        raise DenseVSError(
            f"image has shape {array.shape} and dtype {array.dtype}; "
            "expected RGB uint8 of shape (H, W, 3), at least 16 x 16"
        )
    return array


def check_mask(mask: Any, name: str = "mask") -> np.ndarray:
    """The mask as bool ``(H, W)``; whole numbers count as true where they are not 0.

    Raises:
        DenseVSError: not two dimensions, no pixel, or a type that is neither bool nor integer.
    """
    array = plain_array(mask, name, "bool of shape (H, W)")
    if array.ndim != 2 or not array.size or array.dtype.kind not in "bui":
        raise DenseVSError(f"{name} has shape {array.shape} and dtype {array.dtype}; expected bool of shape (H, W)")
    return array.astype(bool, copy=False)
