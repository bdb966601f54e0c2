"""The hand's pose from images of all cameras: PnP from the camera that sees most, then least reprojection error.

The paper's inference of P_t (Lepetit et al. 2009 there, SQPnP of OpenCV here), and the only one there is for a
Cartesian controller, whose model has no joints.
"""

import numpy as np

from dense_vs.generative.joint_inference import project_points
from dense_vs.generative.levenberg_marquardt import minimize
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.pixel_problem import Free, PixelProblem, State
from dense_vs.generative.resection import resect
from dense_vs.generative.triangulation import rays


def infer_poses(
    parameters: ModelParameters,
    pixels: np.ndarray,
    hand: np.ndarray,
    known_poses: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation ``(B, 3, 3)`` and translation ``(B, 3)`` of the hand's motion from the home pose, and the RMS ``(B,)``.

    Args:
        parameters: of the model.
        pixels: ``(B, c, m, 2)``; NaN where not seen.
        hand: ``(m,)`` the features that stand on the hand.
        known_poses: rotations ``(K, 3, 3)`` and translations ``(K, 3)`` seen before; those whose images are nearest are
            further starts, as few features can look alike from two sides.

    An image with fewer than 4 features of the hand in every camera gives NaN.
    """
    known = hand & finite_rows(parameters.features)
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
    if not posed.any():
        return rotation, translation, rms
    rotations, translations = rotation[posed, None], translation[posed, None]
    if known_poses is not None and len(known_poses[1]) > 0:
        near = _nearest(parameters, part[posed], *known_poses)
        rotations = np.concatenate([rotations, known_poses[0][near]], axis=1)
        translations = np.concatenate([translations, known_poses[1][near]], axis=1)
    starts = rotations.shape[1]
    images = np.repeat(part[posed], starts, axis=0)
    found, costs = _refine(parameters, images, rotations.reshape(-1, 3, 3), translations.reshape(-1, 3))
    best = costs.reshape(-1, starts).argmin(axis=1) + starts * np.arange(posed.sum())
    assert found.rotation is not None
    assert found.translation is not None
    # Once more without the bad starts, whose large costs end the iteration for all.
    found, costs = _refine(parameters, part[posed], found.rotation[best], found.translation[best])
    rotation[posed], translation[posed] = found.rotation, found.translation
    coordinates = 2 * np.isfinite(part[posed][..., 0]).sum(axis=(1, 2))
    rms[posed] = np.sqrt(costs / np.maximum(coordinates, 1))
    return rotation, translation, rms


def _refine(
    parameters: ModelParameters, images: np.ndarray, rotation: np.ndarray, translation: np.ndarray
) -> tuple[State, np.ndarray]:
    """Least squares of each image's own pose, all at once, and the costs (B,) [px^2]."""
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
    problem = PixelProblem(images, still.links, 0, Free(), "pose")
    state = State(still, np.zeros((len(images), 0)), rotation, translation)
    lost = np.any(problem.seen & ~np.isfinite(problem.pixel_errors(state)), axis=(1, 2))
    problem.reweight(np.where(np.reshape(lost, (-1, 1, 1)), 0.0, 1.0))
    state = minimize(problem, state, 30).state
    costs = np.nansum(problem.pixel_errors(state) ** 2, axis=(1, 2))
    return state, np.where(lost, np.inf, costs)


def _nearest(
    parameters: ModelParameters, images: np.ndarray, rotation: np.ndarray, translation: np.ndarray, count: int = 3
) -> np.ndarray:
    """Numbers (B, k) of the known poses whose images are nearest."""
    world = np.einsum("kij,mj->kmi", rotation, np.nan_to_num(parameters.features)) + translation[:, None]
    seen = project_points(parameters, world)
    count = min(count, len(seen))
    chosen = np.empty((len(images), count), dtype=int)
    for number, image in enumerate(images):
        known = np.isfinite(image[..., 0])
        distance = np.abs(seen[:, known] - image[known]).sum(axis=2)
        chosen[number] = np.argsort(np.where(np.isfinite(distance), distance, 1e4).mean(axis=1), kind="stable")[:count]
    return chosen


def _median_error(
    parameters: ModelParameters, flat: np.ndarray, rotation: np.ndarray, translation: np.ndarray
) -> float:
    """Median distance in normalised coordinates over all cameras."""
    world = parameters.features @ rotation.T + translation
    p = np.einsum("cij,mj->cmi", parameters.camera_rotation, world) + parameters.camera_translation[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.linalg.norm(p[..., :2] / p[..., 2:] - flat, axis=2)
    return float(np.nanmedian(np.where(p[..., 2] > 0, errors, np.inf)))
