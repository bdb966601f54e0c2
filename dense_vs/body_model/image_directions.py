"""In what direction an image tells where a place is: an edge says nothing along itself (beyond the papers).

Along the strongest direction of a patch's structure tensor its place is found best; along the other, with the smaller
eigenvalue, the error is larger by the root of their ratio (Foerstner 1987). On plain links most features lie on edges:
tracked from one image of an arm to the next they were 3 times as far off along them as across, by the truth.
"""

import cv2
import numpy as np

WINDOW = 15  # px, side of the patch
NOISE = 0.01  # squared gray levels a px, added to the tensor: where nothing is seen all directions are alike
MARGIN = 13  # px about the places that their patches, blurred, reach
LEAST = 0.1  # weight of a place along the direction that tells least: corners of noise tell something


def direction_weights(gray: np.ndarray, places: np.ndarray) -> np.ndarray:
    """What errors of places are multiplied by, symmetric ``(K, 2, 2)``: 1 across the strongest edge, less along it.

    Args:
        gray: uint8 ``(H, W)``.
        places: ``(K, 2)`` [px]; of one outside the image the nearest pixel counts.
    """
    if not len(places):
        return np.zeros((0, 2, 2))
    height, width = gray.shape
    column, row = np.rint(np.fmin(np.fmax(places, 0), (width - 1, height - 1))).astype(int).T  # 0 for what is nan
    left, top = max(0, column.min() - MARGIN), max(0, row.min() - MARGIN)
    around = gray[top : row.max() + MARGIN + 1, left : column.max() + MARGIN + 1]
    smooth = cv2.GaussianBlur(around, (0, 0), 0.8)
    dx, dy = (cv2.Scharr(smooth, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
    products = cv2.blur(cv2.merge([dx * dx, dx * dy, dy * dy]), (WINDOW, WINDOW))
    xx, xy, yy = products[row - top, column - left].T.astype(np.float64)
    tensor = np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)
    middle, half = (xx + yy) / 2, (xx - yy) / 2
    apart = np.hypot(half, xy)  # half of what the eigenvalues differ by
    least, most = (np.maximum(middle + way * apart, 0) + NOISE for way in (-1, 1))
    along = np.maximum(np.sqrt(least / most), LEAST)
    # Of a unit vector v across the edge, v v' = (T - smaller eigenvalue) / difference.
    across = tensor - (middle - apart)[:, None, None] * np.eye(2)
    across *= np.divide(1 - along, 2 * apart, out=np.zeros_like(apart), where=apart > 0)[:, None, None]
    return across + along[:, None, None] * np.eye(2)
