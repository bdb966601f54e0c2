"""Features and cameras placed through a chain that is known: triangulation over the arm's motion, and resection."""

from dataclasses import replace

import numpy as np

from dense_vs.generative.least_squares.parameters import ModelParameters, finite_rows, link_poses
from dense_vs.generative.reconstruction.resection import resect
from dense_vs.generative.reconstruction.triangulation import rays, triangulate

CAMERA_POINTS = 4  # fewest detections that place a camera
PARALLAX = 1e7  # condition of the normal matrix beyond which rays are too nearly one


def place_features(
    parameters: ModelParameters, pixels: np.ndarray, joints: np.ndarray, which: np.ndarray | None = None
) -> ModelParameters:
    """Triangulate the features ``which`` ``(m,)``, those that are NaN unless given, from pixels ``(T, c, m, 2)``.

    Features that fewer than two rays fix stay NaN.
    """
    missing = ~finite_rows(parameters.features) if which is None else which
    if not missing.any():
        return parameters
    rotation, translation = link_poses(parameters, joints)
    known = finite_rows(parameters.camera_translation)
    flat = np.where(known[:, None, None], rays(pixels, parameters.intrinsics), np.nan)
    shifts = np.nan_to_num(parameters.camera_translation)
    features = parameters.features.copy()
    for feature in np.flatnonzero(missing):
        link = parameters.links[feature]
        turn = np.einsum("cij,tjk->tcik", parameters.camera_rotation, rotation[:, link]).reshape(-1, 3, 3)
        shift = np.einsum("cij,tj->tci", parameters.camera_rotation, translation[:, link]) + shifts
        views = flat[:, :, feature].reshape(1, -1, 2)
        weights = np.ones(views.shape[:2])
        place = triangulate(views, turn, shift.reshape(-1, 3), weights, PARALLAX)[0]
        for _ in range(4):  # mistaken labels lose their weight
            if not np.isfinite(place).all():
                break
            p = turn @ place + shift.reshape(-1, 3)
            with np.errstate(divide="ignore", invalid="ignore"):
                errors = np.linalg.norm(p[:, :2] / p[:, 2:] - views[0], axis=1)
            scale = 2 * np.nanmedian(errors) + 1e-9
            weights = 1 / (1 + (np.nan_to_num(errors)[None] / scale) ** 2)
            place = triangulate(views, turn, shift.reshape(-1, 3), weights, PARALLAX)[0]
        features[feature] = place
    return replace(parameters, features=features)


def place_cameras(
    parameters: ModelParameters,
    pixels: np.ndarray,
    joints: np.ndarray,
    intrinsics: np.ndarray,
    which: np.ndarray | None = None,
) -> ModelParameters:
    """Resect the cameras ``which`` ``(c,)``, those that are NaN unless given, from features that are known.

    Cameras that see fewer than ``CAMERA_POINTS`` of them stay NaN.
    """
    missing = ~finite_rows(parameters.camera_translation) if which is None else which
    rotation, translation = link_poses(parameters, joints)
    world = np.einsum("tmij,mj->tmi", rotation[:, parameters.links], parameters.features)
    world = world + translation[:, parameters.links]
    turns, shifts = parameters.camera_rotation.copy(), parameters.camera_translation.copy()
    inner = parameters.intrinsics.copy()
    inner[missing] = intrinsics[missing]
    flat = rays(pixels, inner)
    for camera in np.flatnonzero(missing):
        usable = np.isfinite(flat[:, camera, :, 0]) & np.isfinite(world[..., 0])
        found = resect(world[usable], flat[:, camera][usable]) if usable.sum() >= CAMERA_POINTS else None
        shifts[camera] = np.nan
        if found is not None:
            turns[camera], shifts[camera] = found
    return replace(parameters, camera_rotation=turns, camera_translation=shifts, intrinsics=inner)
