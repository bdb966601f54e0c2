"""A camera's pose from points that are known: SQPnP, random samples against mistakes, refinement by OpenCV."""

import cv2
import numpy as np


def resect(points: np.ndarray, normalized: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """World-to-camera pose from points ``(k, 3)`` and their normalised coordinates ``(k, 2)``; None if there is none.

    SQPnP, then Levenberg-Marquardt of OpenCV on those that fit.
    """
    best, best_error = None, np.inf
    try:
        found, turn, shift = cv2.solvePnP(points, normalized, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:  # points in one place or on a line
        return None
    trials = [(turn, shift)] if found else []
    if len(points) >= 8:
        threshold = max(4 * np.median(_pnp_errors(points, normalized, turn, shift)), 2e-3) if found else 0.01
        drawn = cv2.solvePnPRansac(
            points,
            normalized,
            np.eye(3),
            None,
            iterationsCount=100,
            reprojectionError=threshold,
            flags=cv2.SOLVEPNP_SQPNP,
        )
        trials += [drawn[1:3]] if drawn[0] else []
    for first_turn, first_shift in trials:
        turn, shift = first_turn, first_shift
        errors = _pnp_errors(points, normalized, turn, shift)
        sound = errors <= 5 * np.median(errors) + 1e-9
        if sound.sum() >= 4:
            turn, shift = cv2.solvePnPRefineLM(points[sound], normalized[sound], np.eye(3), None, turn, shift)
        rotation = cv2.Rodrigues(turn)[0]
        ahead = (points @ rotation[2] + shift[2, 0] > 0).mean()
        error = float(np.median(_pnp_errors(points, normalized, turn, shift)))
        if ahead > 0.5 and error < best_error and np.isfinite(error):
            best, best_error = (rotation, shift[:, 0].copy()), error
    return best


def _pnp_errors(points: np.ndarray, normalized: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    projected = cv2.projectPoints(points, turn, shift, np.eye(3), None)[0][:, 0]
    return np.linalg.norm(projected - normalized, axis=1)
