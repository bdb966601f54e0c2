"""How plain an image is about a point, and by how much farther away a plain surface seems than it is.

What is seen of a plain surface is shading and outlines, which turn less than its link does: tracks of four commercial
arms show 0 to 1.5 % less motion than the surface has. So the chain that explains them has what is on plain links too
far away, and what is on textured ones where it is. Found at 213 places of nine arms (178 in clean images, 35 in
realistic ones) by what depth explains where they truly are in 400 postures. What surfaces have was found anew since
they are sought in more images, at the ends of reaches in 22 views and over six whole bodies.
"""

import cv2
import numpy as np

RADIUS = 19  # px about the point
BLUR = 1.0  # px
TEXTURED = 5.0  # gray values per px, the median about a point, at which a third of the error is left
# Of the logarithm of the depth, by which it seems greater where the image is plain:
OWN_SLIP = 0.037  # by the point's own look
FEATURES_SLIP = 0.04  # by features of its link
SURFACE_SLIP = 0.005  # by the surface of a body model; 0.019 when it was found from 9 keyframes, not 21


def plainness(gray: np.ndarray, point: np.ndarray) -> float:
    """How plain an image uint8 ``(H, W)`` is about a point ``(2,)`` [px]: 1 where nothing is to be seen, else less."""
    x, y = (round(float(at)) for at in point)
    rows, columns = (slice(max(0, at - RADIUS - 2), at + RADIUS + 3) for at in (y, x))
    smooth = cv2.GaussianBlur(gray[rows, columns], (0, 0), BLUR).astype(np.float64)
    down, right = np.gradient(smooth)
    away = np.hypot(np.arange(gray.shape[0])[rows, None] - y, np.arange(gray.shape[1])[columns] - x)
    return float(np.exp(-np.median(np.hypot(down, right)[away <= RADIUS]) / TEXTURED))
