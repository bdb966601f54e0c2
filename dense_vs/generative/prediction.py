"""The forward model of Gothoskar et al., I_t = C_V(S_F(K_R(j_t))): links, features and pixels at given joints."""

import numpy as np

from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.rotations import rotation_matrices


def link_poses(parameters: ModelParameters, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation ``(T, n + 1, 3, 3)`` and translation ``(T, n + 1, 3)`` of every link's motion from the home pose."""
    samples = len(joints)
    rotation, translation = parameters.base_rotation, parameters.base_translation
    rotations = [np.broadcast_to(rotation, (samples, 3, 3))]
    translations = [np.broadcast_to(translation, (samples, 3))]
    for axis, point, angle in zip(parameters.axes, parameters.points, (joints - parameters.home).T, strict=True):
        step = rotation_matrices(angle[:, None] * axis)
        translations.append(translations[-1] + np.einsum("tij,tj->ti", rotations[-1], point - step @ point))
        rotations.append(rotations[-1] @ step)
    return np.stack(rotations, axis=1), np.stack(translations, axis=1)


def predict(parameters: ModelParameters, joints: np.ndarray) -> np.ndarray:
    """Pixels ``(T, c, m, 2)`` of the features at joints ``(T, n)``; NaN behind a camera."""
    rotation, translation = link_poses(parameters, joints)
    world = np.einsum("tmij,mj->tmi", rotation[:, parameters.links], parameters.features)
    return project_points(parameters, world + translation[:, parameters.links])


def project_points(parameters: ModelParameters, world: np.ndarray) -> np.ndarray:
    """Pixels ``(..., c, m, 2)`` of points ``(..., m, 3)``; NaN behind a camera."""
    p = np.einsum("cij,...mj->...cmi", parameters.camera_rotation, world)
    p += parameters.camera_translation[:, None]
    depth = np.where(p[..., 2:] > 0, p[..., 2:], np.nan)
    k = parameters.intrinsics[:, None]
    ab = p[..., :2] / depth
    if np.any(parameters.intrinsics[:, 4:]):
        r2 = (ab**2).sum(axis=-1)
        ab = ab * (1 + r2 * (k[..., 4] + r2 * k[..., 5]))[..., None]
    return ab * k[..., :2] + k[..., 2:4]
