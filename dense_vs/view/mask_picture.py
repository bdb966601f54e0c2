"""A mask drawn into its image: outline and tint, with a word on what the mask is good for."""

import cv2
import numpy as np

from dense_vs.view.panels import label

_TINT = np.array((80, 255, 80), np.float32)  # RGB; seldom an object's own colour
_OUTLINE = (0, 255, 0)


def draw_mask(image: np.ndarray, mask: np.ndarray, text: str) -> np.ndarray:
    """A copy of an RGB uint8 image (H, W, 3) with a mask (H, W) tinted and outlined, and text in its corner."""
    drawn = image.astype(np.float32)
    drawn[mask] = 0.7 * drawn[mask] + 0.3 * _TINT
    drawn = np.ascontiguousarray(drawn.astype(np.uint8))
    outlines = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(drawn, outlines, -1, _OUTLINE, 1)
    return label(drawn, text)
