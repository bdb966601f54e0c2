"""The hand's pose in every sample, from features that are triangulated or seen: the paper's chain of alignments.

Where the paper composes rigid motions between pairs of samples, all are aligned to one structure that grows with them:
by three or more triangulated features (Arun et al. 1987), else by resection from one camera.
"""

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.reconstruction.resection import resect
from dense_vs.generative.reconstruction.triangulation import rigid_motions, triangulate

SOUND_ALIGNMENT = 0.1  # median error as a share of the structure's size that needs no other seed
FLAT = 0.1  # second extent of points, as a share of the structure's size, that fixes no rotation


def align_samples(
    flat: np.ndarray, seen: np.ndarray, placed: np.ndarray, camera_rotation: np.ndarray, camera_translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Poses of the samples and structure, from the samples in which placed cameras see features together.

    Args:
        flat: ``(T, c, m, 2)`` normalized coordinates.
        seen: ``(T, c, m)``.
        placed: ``(c,)`` cameras whose pose is known.
        camera_rotation, camera_translation: ``(c, 3, 3)``, ``(c, 3)``.

    Returns:
        rotation ``(T, 3, 3)``, translation ``(T, 3)``, structure ``(m, 3)`` with NaN, posed ``(T,)``.

    Raises:
        DenseVSError: no sample has three features that are not in a line.
    """
    views = Views(flat, seen, placed, camera_rotation, camera_translation)
    points = views.points
    known = np.isfinite(points[..., 0])
    seeds = [
        t for t in np.argsort(-known.sum(axis=1), kind="stable")[:4] if spread(points[t], known[t][None])[0] > 1e-6
    ]
    if not seeds:
        raise DenseVSError(
            "no sample has three features, off a line, that two cameras see together; expected such samples to align"
        )
    best, best_score = None, (-1, np.inf)
    for seed in seeds:
        samples = len(points)
        rotation, translation = np.tile(np.eye(3), (samples, 1, 1)), np.zeros((samples, 3))
        posed = np.arange(samples) == seed
        structure = grow(views, points[seed].copy(), rotation, translation, posed)
        error = np.linalg.norm(np.einsum("tij,mj->tmi", rotation, structure) + translation[:, None] - points, axis=2)
        error = error[posed]
        score = (int(posed.sum()), float(np.median(error[np.isfinite(error)])))
        if score[0] > 1.1 * best_score[0] or (score[0] > 0.9 * best_score[0] and score[1] < best_score[1]):
            best, best_score = (rotation, translation, structure, posed), score
        if best_score[0] >= 0.95 * samples and best_score[1] < SOUND_ALIGNMENT * np.sqrt(np.nanvar(structure, 0).sum()):
            break
    assert best is not None
    return best


class Views:
    """Views of the placed cameras, and the features that they triangulate in each sample.

    Args:
        flat: ``(T, c, m, 2)`` normalized coordinates.
        seen: ``(T, c, m)``.
        placed: ``(c,)`` cameras whose pose is known.
        rotation, translation: ``(c, 3, 3)``, ``(c, 3)`` world to camera.
    """

    def __init__(
        self, flat: np.ndarray, seen: np.ndarray, placed: np.ndarray, rotation: np.ndarray, translation: np.ndarray
    ):
        self.seen = seen & placed[:, None]
        self.flat = np.where(self.seen[..., None], flat, np.nan)
        self.rotation, self.translation = rotation, translation
        self.points = triangulate(self.flat.swapaxes(1, 2), rotation, translation)
        depth = np.einsum("cj,tmj->tmc", rotation[:, 2], self.points) + translation[:, 2]
        self.points[((depth <= 0) & self.seen.swapaxes(1, 2)).any(axis=2)] = np.nan
        self.known = np.isfinite(self.points[..., 0])

    def structure(self, rotation: np.ndarray, translation: np.ndarray, posed: np.ndarray) -> np.ndarray:
        """Features in the hand's axes: medians of those triangulated in single samples, else through the motion."""
        own = np.einsum("tji,tmj->tmi", rotation, self.points - translation[:, None])[posed]
        often = np.isfinite(own[..., 0]).any(axis=0)
        structure = np.full(own.shape[1:], np.nan)
        structure[often] = np.nanmedian(own[:, often], axis=0)
        if not often.all():
            turns = np.einsum("cij,tjk->tcik", self.rotation, rotation[posed]).reshape(-1, 3, 3)
            shifts = np.einsum("cij,tj->tci", self.rotation, translation[posed]) + self.translation
            views = self.flat[posed][:, :, ~often].reshape(len(turns), -1, 2).swapaxes(0, 1)
            structure[~often] = triangulate(views, turns, shifts.reshape(-1, 3), max_condition=1e5)
        return structure


def grow(
    views: Views, structure: np.ndarray, rotation: np.ndarray, translation: np.ndarray, posed: np.ndarray
) -> np.ndarray:
    """Pose sample after sample by the structure known so far, which grows with them; poses are changed in place."""
    size = np.sqrt(np.nanvar(structure, axis=0).sum())
    flat_limit = FLAT * size

    def align(which: np.ndarray, least: int) -> np.ndarray:
        """Pose samples by triangulated features; those that it could."""
        shared = views.known[which] & np.isfinite(structure[:, 0])
        able = shared.sum(axis=1) >= least
        able[able] = spread(structure, shared[able]) > flat_limit
        if able.any():
            chosen = which[able]
            rotation[chosen], translation[chosen] = robust_motions(structure, views.points[chosen], shared[able])
        return which[able]

    def resected(t: int, least: int) -> bool:
        """Pose a sample from the camera that sees most of the structure."""
        visible = views.seen[t] & np.isfinite(structure[:, 0])
        camera = int(np.argmax(visible.sum(axis=1)))
        chosen = visible[camera]
        if chosen.sum() < least or spread(structure, chosen[None])[0] <= flat_limit:
            return False
        found = resect(structure[chosen], views.flat[t, camera][chosen])
        if found is None:
            return False
        turn = views.rotation[camera].T
        rotation[t], translation[t] = turn @ found[0], turn @ (found[1] - views.translation[camera])
        return True

    for least, least_pnp in ((5, 7), (4, 6), (3, 5), (3, 4)) * 3:
        for _ in range(len(posed)):
            fresh = align(np.flatnonzero(~posed), least)
            others = np.setdiff1d(np.flatnonzero(~posed), fresh)
            fresh = [*fresh, *(t for t in others if resected(int(t), least_pnp))]
            if not fresh:
                break
            posed[fresh] = True
            structure = views.structure(rotation, translation, posed)
    for _ in range(3):
        aligned = align(np.flatnonzero(posed), 4)
        for t in np.setdiff1d(np.flatnonzero(posed), aligned):
            resected(int(t), 7)
        structure = views.structure(rotation, translation, posed)
    return structure


def robust_motions(source: np.ndarray, targets: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motions of ``source`` ``(m, 3)`` to each of ``targets`` ``(k, m, 3)`` by the points of ``mask`` ``(k, m)``.

    Where there are more than three points, those that fit badly lose weight.
    """
    points, places = np.nan_to_num(source)[None], np.nan_to_num(targets)
    weights = mask.astype(float)
    rotation, translation = rigid_motions(points, places, weights)
    for _ in range(4):
        moved = np.einsum("kij,mj->kmi", rotation, points[0]) + translation[:, None]
        errors = np.where(mask, np.linalg.norm(moved - places, axis=2), np.nan)
        scale = 1.5 * np.nanmedian(errors, axis=1, keepdims=True) + 1e-12
        weights = np.where(mask, 1 / (1 + (np.nan_to_num(errors) / scale) ** 2), 0.0)
        weights = np.where(mask.sum(axis=1, keepdims=True) > 3, weights, mask)
        rotation, translation = rigid_motions(points, places, weights)
    return rotation, translation


def spread(points: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """Second extent ``(k,)`` of the points ``(m, 3)`` of each mask ``(k, m)``: 0 on a line or for fewer than 3."""
    weights = masks / np.maximum(masks.sum(axis=1, keepdims=True), 1)
    known = np.nan_to_num(points)
    middle = weights @ known
    scatter = np.einsum("km,kmi,kmj->kij", weights, known - middle[:, None], known - middle[:, None])
    values = np.linalg.eigvalsh(scatter)
    return np.where(masks.sum(axis=1) >= 3, np.sqrt(np.maximum(values[:, 1], 0.0)), 0.0)
