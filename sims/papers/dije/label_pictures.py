"""Pictures of labels: over the camera image as in DIJE's Fig. 4, and the stages before them as in Fig. 2."""

from pathlib import Path

import cv2
import numpy as np

from dense_vs.files import atomic_write
from dense_vs.view.panels import GREEN, RED, label

YELLOW = (255, 220, 60)


def overlay(rgb: np.ndarray, own: np.ndarray, robot: np.ndarray, walker: np.ndarray, text: str) -> np.ndarray:
    """Labels in red over an image ``(H, W, 3)``, with the true outlines of robot (green) and walker (yellow)."""
    painted = rgb.copy()
    painted[own] = (0.45 * rgb[own] + 0.55 * np.array(RED)).astype(np.uint8)
    for mask, color in ((walker, YELLOW), (robot, GREEN)):
        outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(painted, outlines, -1, color, 1)
    return label(painted, text)


def states_image(states: np.ndarray, text: str) -> np.ndarray:
    """Own pixels red, others gray, unknown ones black."""
    colors = np.array([(0, 0, 0), (120, 120, 120), RED], dtype=np.uint8)
    return label(colors[states.astype(int) + 1], text)


def clusters_image(index: np.ndarray, own: np.ndarray, text: str) -> np.ndarray:
    """Each cluster in its own shade, as Fig. 2: of red where it is the body's, of blue elsewhere; -1 black.

    Args:
        index: ``(H, W)``.
        own: ``(H, W)`` bool.
        text: label.
    """
    count = max(int(index.max()) + 1, 1)
    shade = np.where(index >= 0, 90 + 165 * (index.astype(int) + 1) // count, 0).astype(np.uint8)
    image = np.zeros((*index.shape, 3), np.uint8)
    image[..., 0] = np.where(own, shade, 0)
    image[..., 2] = np.where(own, 0, shade)
    return label(image, text)


def share_image(share: np.ndarray, text: str) -> np.ndarray:
    """A share from 0 (white) to 1 (black); what is not a number dark blue."""
    known = np.isfinite(share)
    gray = (255 * (1 - np.clip(np.where(known, share, 1), 0, 1))).astype(np.uint8)
    image = np.repeat(gray[..., None], 3, axis=2)
    image[~known] = (0, 0, 70)
    return label(image, text)


def write_image(path: Path, image: np.ndarray, scale: int = 2) -> None:
    """Write an RGB image as PNG, enlarged."""
    large = image if scale == 1 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    done, data = cv2.imencode(".png", cv2.cvtColor(large, cv2.COLOR_RGB2BGR))
    assert done
    with atomic_write(path) as stream:
        stream.write(data.tobytes())
