"""A camera's pose from points that are known: SQPnP, random samples against mistakes, refinement by OpenCV."""

import cv2
import numpy as np

FITS = 4e-3  # error in normalized coordinates, some pixels: where all are below, none is a mistake
ENOUGH_TO_DRAW = 8  # points


def resect(points: np.ndarray, normalized: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """World-to-camera pose from points ``(k, 3)`` and their normalized coordinates ``(k, 2)``; None if there is none.

    SQPnP, then Levenberg-Marquardt of OpenCV on those that fit; from random samples too where some do not.
    """
    try:
        return _resected(points, normalized)
    except cv2.error:  # points in one place or on a line, or so far away that OpenCV's numbers overflow
        return None


def _resected(points: np.ndarray, normalized: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    found, turn, shift = cv2.solvePnP(points, normalized, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
    best, threshold = None, 0.01
    if found:
        threshold = max(4 * float(np.median(_pnp_errors(points, normalized, turn, shift))), 2e-3)
        best = _refined(points, normalized, turn, shift)
    if len(points) >= ENOUGH_TO_DRAW and (best is None or best[2].max() > FITS):
        drawn, turn, shift, _ = cv2.solvePnPRansac(
            points,
            normalized,
            np.eye(3),
            None,
            iterationsCount=100,
            reprojectionError=threshold,
            flags=cv2.SOLVEPNP_SQPNP,
        )
        other = _refined(points, normalized, turn, shift) if drawn else None
        if other is not None and (best is None or np.median(other[2]) < np.median(best[2])):
            best = other
    return None if best is None else best[:2]


def _refined(
    points: np.ndarray, normalized: np.ndarray, turn: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Rotation, translation and errors ``(k,)`` after a fit of the points that fit; None if most are behind."""
    errors = _pnp_errors(points, normalized, turn, shift)
    sound = errors <= 5 * np.median(errors) + 1e-9
    if sound.sum() >= 4:
        turn, shift = cv2.solvePnPRefineLM(points[sound], normalized[sound], np.eye(3), None, turn, shift)
    rotation, errors = cv2.Rodrigues(turn)[0], _pnp_errors(points, normalized, turn, shift)
    ahead = (points @ rotation[2] + shift[2, 0] > 0).mean() > 0.5
    return (rotation, shift[:, 0].copy(), errors) if ahead and np.isfinite(errors).all() else None


def _pnp_errors(points: np.ndarray, normalized: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    projected = cv2.projectPoints(points, turn, shift, np.eye(3), None)[0][:, 0]
    return np.linalg.norm(projected - normalized, axis=1)
