"""The hand's pose from images of all cameras: PnP from the camera that sees most, then least reprojection error.

The paper's inference of P_t (Lepetit et al. 2009 there, SQPnP of OpenCV here), and the only one there is for a
Cartesian controller, whose model has no joints.
"""

import numpy as np

from dense_vs.generative.levenberg_marquardt import minimize
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.pixel_problem import Free, PixelProblem, State
from dense_vs.generative.stereo import resect
from dense_vs.generative.triangulation import rays


def infer_poses(
    parameters: ModelParameters, pixels: np.ndarray, hand: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation ``(B, 3, 3)`` and translation ``(B, 3)`` of the hand's motion from the home pose, and the RMS ``(B,)``.

    Args:
        parameters: of the model.
        pixels: ``(B, c, m, 2)``; NaN where not seen.
        hand: ``(m,)`` the features that stand on the hand.

    An image with fewer than 4 features of the hand in every camera gives NaN.
    """
    known = hand & np.isfinite(parameters.features).all(axis=1)
    part = np.where(known[:, None], pixels, np.nan)
    flat = rays(part, parameters.intrinsics)
    count = len(pixels)
    rotation, translation = np.tile(np.eye(3), (count, 1, 1)), np.full((count, 3), np.nan)
    for image in range(count):
        visible = np.isfinite(flat[image, ..., 0]).sum(axis=1)
        best = np.inf
        for camera in np.flatnonzero(visible >= 4):
            chosen = np.isfinite(flat[image, camera, :, 0])
            found = resect(parameters.features[chosen], flat[image, camera][chosen])
            if found is None:
                continue
            turn = parameters.camera_rotation[camera].T
            trial = turn @ found[0], turn @ (found[1] - parameters.camera_translation[camera])
            error = _median_error(parameters, flat[image], *trial)
            if error < best:
                best = error
                rotation[image], translation[image] = trial
    posed = np.isfinite(translation[:, 0])
    rms = np.full(count, np.nan)
    if posed.any():
        still = ModelParameters(
            np.zeros((0, 3)),
            np.zeros((0, 3)),
            np.zeros(0),
            np.nan_to_num(parameters.features),
            np.zeros(len(parameters.features), int),
            parameters.camera_rotation,
            parameters.camera_translation,
            parameters.intrinsics,
        )
        problem = PixelProblem(part[posed], still.links, 0, Free(), "pose")
        state = State(still, np.zeros((posed.sum(), 0)), rotation[posed], translation[posed])
        behind = problem.seen & ~np.isfinite(problem.pixel_errors(state))
        problem.reweight(np.where(behind, 0.0, 1.0))
        state = minimize(problem, state, 20).state
        rotation[posed], translation[posed] = state.rotation, state.translation
        squares = np.nansum(problem.pixel_errors(state) ** 2, axis=(1, 2))
        rms[posed] = np.sqrt(squares / np.maximum(2 * problem.seen.sum(axis=(1, 2)), 1))
    return rotation, translation, rms


def _median_error(parameters: ModelParameters, flat: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> float:
    """Median distance in normalised coordinates over all cameras."""
    world = parameters.features @ rotation.T + translation
    p = np.einsum("cij,mj->cmi", parameters.camera_rotation, world) + parameters.camera_translation[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.linalg.norm(p[..., :2] / p[..., 2:] - flat, axis=2)
    return float(np.nanmedian(np.where(p[..., 2] > 0, errors, np.inf)))
