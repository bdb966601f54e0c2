"""Drawn images of an ellipse to be found, with its exact mask."""

import cv2
import numpy as np

HEIGHT, WIDTH = 160, 200


def drawn(rng, size=None, color=(200, 60, 40)):
    """An image of an ellipse among others of other colors on a mottled ground, and its mask."""
    ground = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 4)
    image = np.full((HEIGHT, WIDTH, 3), (120, 125, 110), np.float32) + 150 * ground[..., None]
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for other in ((60, 80, 170), (70, 150, 80)):
        cv2.ellipse(image, _place(rng), (int(rng.integers(8, 20)), 12), int(rng.integers(180)), 0, 360, other, -1)
    if size != 0:
        axes = (size, size) if size else (int(rng.integers(12, 26)), int(rng.integers(8, 16)))
        cv2.ellipse(mask, _place(rng), axes, int(rng.integers(180)), 0, 360, 1, -1)
        image[mask > 0] = color
    image += 3 * rng.standard_normal(image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), mask.astype(bool)


def _place(rng):
    return int(rng.integers(40, WIDTH - 40)), int(rng.integers(40, HEIGHT - 40))


def shown_at(x, y, rng):
    """An image of the ellipse with its middle at (x, y), and its mask."""
    image, _ = drawn(rng, 0)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.ellipse(mask, (x, y), (18, 11), 30, 0, 360, 1, -1)
    image[mask > 0] = (200, 60, 40)
    return image, mask.astype(bool)
