"""How far a camera that sways moved each of some images, by what stands still in them."""

from collections.abc import Sequence

import cv2
import numpy as np

from dense_vs.body_model.feature_flow import carried, new_features
from dense_vs.flow.camera_motion import CameraMotion, fit_camera_motion

FEATURES, APART = 250, 6  # corners of the first image, and px between them
BESIDE = 8  # px from the body, within which nothing counts as standing still
LEAST_AGREE = 0.5  # of the corners that the body does not cover
MOST = 3.0  # px at the image's corners; more is a camera that was moved


def motions_to_first(images: Sequence[np.ndarray], covered: Sequence[np.ndarray]) -> list[CameraMotion]:
    """What takes places of each image to the first one's; no motion where too little of what stands still agrees.

    Args:
        images: gray uint8 ``(H, W)``.
        covered: bool ``(H, W)`` of each, where the body is.
    """
    still = [cv2.dilate(body.astype(np.uint8), np.ones((2 * BESIDE + 1,) * 2, np.uint8)) == 0 for body in covered]
    begun = new_features(images[0], still[0], FEATURES, APART)
    height, width = images[0].shape
    motions = [CameraMotion.none()]
    for image, free in zip(images[1:], still[1:], strict=True):
        there, seen = carried(images[0], image, begun, begun)
        seen &= _at(free, there)
        motion = fit_camera_motion(begun[seen], begun[seen] - there[seen])
        least = LEAST_AGREE * np.count_nonzero(_at(free, begun))
        if motion is None or motion.inliers * np.count_nonzero(seen) < least:
            motion = CameraMotion.none()
        motions.append(motion if motion.largest(height, width) <= MOST else CameraMotion.none())
    return motions


def _at(mask: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A mask ``(H, W)`` at places ``(K, 2)`` [px], or next to them where they are outside."""
    x, y = np.clip(np.rint(places).astype(int), 0, [mask.shape[1] - 1, mask.shape[0] - 1]).T
    return mask[y, x]
