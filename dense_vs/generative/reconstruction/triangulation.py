"""Points from rays of several cameras, and rigid motions between point sets, for the paper's initialisation."""

import numpy as np


def rays(pixels: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Normalised image coordinates of pixels ``(T, c, m, 2)``, radial distortion undone."""
    k = intrinsics[:, None]
    distorted = (pixels - k[..., 2:4]) / k[..., :2]
    plain = distorted
    if np.any(intrinsics[:, 4:]):
        for _ in range(20):  # fixed point, as OpenCV's undistortPoints
            r2 = (plain**2).sum(axis=-1)
            plain = distorted / (1 + r2 * (k[..., 4] + r2 * k[..., 5]))[..., None]
    return plain


def triangulate(
    normalized: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    weights: np.ndarray | None = None,
    max_condition: float = 1e10,
) -> np.ndarray:
    """Points ``(..., 3)`` from normalised coordinates ``(..., v, 2)`` in v views, linear least squares.

    Args:
        normalized: NaN where not seen.
        rotation: ``(..., v, 3, 3)`` world to view; broadcast.
        translation: ``(..., v, 3)``.
        weights: ``(..., v)``.
        max_condition: of the normal matrix; beyond, the rays are too nearly one.

    A point seen in fewer than two views, or of one ray only, is NaN. Two passes: the second divides each equation by
    the depth that the first one found, so that errors count in the image.
    """
    known = ~np.isnan(normalized[..., 0])
    weight = known * (1.0 if weights is None else weights)
    xy = np.where(known[..., None], normalized, 0.0)
    rotation = np.broadcast_to(rotation, (*xy.shape[:-1], 3, 3))
    translation = np.broadcast_to(translation, (*xy.shape[:-1], 3))
    # (x r_3 - r_1) X = t_1 - x t_3, and the same for y.
    design = xy[..., None] * rotation[..., 2:, :] - rotation[..., :2, :]
    right = translation[..., :2] - xy * translation[..., 2:]
    enough = (weight > 0).sum(axis=-1) >= 2
    for _ in range(2):
        root = weight[..., None, None]
        normal = np.einsum("...vki,...vkj->...ij", design * root, design)
        target = np.einsum("...vki,...vk->...i", design * root, right)
        sound = enough & (np.linalg.cond(normal) < max_condition)
        normal = np.where(sound[..., None, None], normal, np.eye(3))
        points = np.where(sound[..., None], np.linalg.solve(normal, target[..., None])[..., 0], np.nan)
        depth = np.einsum("...vi,...i->...v", rotation[..., 2, :], np.nan_to_num(points)) + translation[..., 2]
        weight = known * (1.0 if weights is None else weights) / np.maximum(depth, 1e-3) ** 2
    return points


def rigid_motions(source: np.ndarray, target: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations ``(k, 3, 3)`` and translations ``(k, 3)`` that carry ``source`` to ``target``, both ``(k, m, 3)``.

    Weighted least squares (Arun et al. 1987); ``weights`` are ``(k, m)``.
    """
    weight = (weights / weights.sum(axis=1, keepdims=True))[..., None]
    middle, goal = (weight * source).sum(axis=1), (weight * target).sum(axis=1)
    scatter = (weight * (target - goal[:, None])).swapaxes(1, 2) @ (source - middle[:, None])
    left, _, right = np.linalg.svd(scatter)
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    rotation = left @ right
    return rotation, goal - np.einsum("kij,kj->ki", rotation, middle)
