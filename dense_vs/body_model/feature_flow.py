"""Small features of a surface, taken from one image to the next by Lucas and Kanade's method."""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np

MOST_RETURN = 0.4  # px between a feature and where the way back from its new place ends
EDGE = 3  # px from the image's border, where a feature is given up
QUALITY = 0.003  # of the strongest corner, which plain surfaces stay far below
_BLOCK = 5  # px, side of what a corner is told by
_CORNER = 8  # px about it, more than that and its slopes reach
_SEARCH: dict[str, Any] = {
    "winSize": (17, 17),
    "maxLevel": 2,
    "criteria": (3, 20, 0.01),
    "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
}


def carried(
    before: np.ndarray, now: np.ndarray, places: np.ndarray, expected: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where features of one image are in another, ``(K, 2)`` [px], and whether that is believed, bool ``(K,)``.

    Args:
        before, now: gray uint8 ``(H, W)``.
        places: ``(K, 2)`` in the first image [px].
        expected: ``(K, 2)`` in the second, from which the search begins [px].
    """
    if not len(places):
        return places.copy(), np.zeros(0, bool)
    start = np.array(places, np.float32, order="C").reshape(-1, 1, 2)
    guess = np.array(np.clip(expected, -1e4, 1e4), np.float32, order="C").reshape(-1, 1, 2)
    there, forward, _ = cv2.calcOpticalFlowPyrLK(before, now, start, guess, **_SEARCH)
    back, backward, _ = cv2.calcOpticalFlowPyrLK(now, before, there, start.copy(), **_SEARCH)
    found = there[:, 0].astype(np.float64)
    height, width = now.shape
    believed = (forward.ravel() == 1) & (backward.ravel() == 1)
    believed &= np.linalg.norm(back[:, 0] - start[:, 0], axis=1) < MOST_RETURN
    believed &= np.all((found >= EDGE) & (found <= (width - 1 - EDGE, height - 1 - EDGE)), axis=1)
    return found, believed


def about(places: np.ndarray, margin: int, shape: tuple[int, ...]) -> np.ndarray:
    """Mask uint8 ``(H, W)`` of what is between some places ``(K, 2)`` [px], or at most ``margin`` px outside."""
    mask = np.zeros(shape, np.uint8)
    hull = cv2.convexHull(np.clip(places, -1e4, 1e4).astype(np.float32))
    cv2.fillConvexPoly(mask, hull.round().astype(np.int32), (1,))
    return cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1)))


def keep_apart(mask: np.ndarray, places: Iterable[np.ndarray], apart: int) -> None:
    """Set a mask uint8 ``(H, W)`` to 0 up to ``apart`` px from some places [px]."""
    for x, y in places:
        cv2.circle(mask, (round(float(x)), round(float(y))), apart, (0,), -1)


def new_features(gray: np.ndarray, where: np.ndarray, count: int, apart: int) -> Any:
    """Up to ``count`` corners ``(K, 2)`` [px] where a mask allows, ``apart`` px from each other.

    Args:
        gray: uint8 ``(H, W)``.
        where: bool or uint8 ``(H, W)``.
        count: most of them.
        apart: [px].
    """
    mask = where.astype(np.uint8)
    x, y, width, height = cv2.boundingRect(mask)
    left, top = max(0, x - _CORNER), max(0, y - _CORNER)  # what is farther away says nothing of a corner
    part = np.s_[top : y + height + _CORNER, left : x + width + _CORNER]
    found = None
    if count > 0 and width:
        found = cv2.goodFeaturesToTrack(gray[part], count, QUALITY, apart, mask=mask[part], blockSize=_BLOCK)
    return np.zeros((0, 2)) if found is None else found.reshape(-1, 2) + np.array([left, top], np.float64)
