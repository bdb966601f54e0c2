"""Stage 1 from two or more cameras: relative camera pose, triangulation, and the hand's pose in every sample.

The paper's Initialization by Triangulation: essential matrix from the matches of all samples, cheirality, triangulated
features, rigid alignment (Arun et al. 1987). Beyond it, further cameras are resected from the points that are already
known rather than pair by pair, and every step tolerates mistaken labels: medians and reweighting instead of means.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.parameters import finite_rows
from dense_vs.generative.triangulation import rays, rigid_motion, triangulate

PAIR_MATCHES = 12  # below, no essential matrix is trusted
SOUND_ALIGNMENT = 0.1  # median error as a share of the structure's size that needs no other seed
PNP_POINTS = 6  # of one camera in one sample


@dataclass
class Reconstruction:
    """Cameras, structure and the hand's poses, in the axes of camera 0.

    Attributes:
        rotation, translation: ``(T, 3, 3)``, ``(T, 3)`` of the hand: structure to world.
        structure: ``(m, 3)`` about its centroid, NaN where a feature could not be placed.
        camera_rotation, camera_translation: ``(c, 3, 3)``, ``(c, 3)`` world to camera.
        posed: ``(T,)`` samples whose pose is known; the others hold their neighbours' value.
        placed_cameras: ``(c,)``.
    """

    rotation: np.ndarray
    translation: np.ndarray
    structure: np.ndarray
    camera_rotation: np.ndarray
    camera_translation: np.ndarray
    posed: np.ndarray
    placed_cameras: np.ndarray


def reconstruct(pixels: np.ndarray, intrinsics: np.ndarray) -> Reconstruction:
    """First estimate from feature pixels ``(T, c, m, 2)`` of the hand and guesses of the intrinsics ``(c, 6)``.

    Raises:
        DenseVSError: no two cameras share enough features, or they never share three in a sample.
    """
    cameras = pixels.shape[1]
    seen = ~np.isnan(pixels[..., 0])
    a, b, matches = best_pair(seen)
    if matches < PAIR_MATCHES:
        raise DenseVSError(
            f"cameras {a} and {b}, the best pair, saw the same feature of the hand together in {matches} cases; "
            f"expected at least {PAIR_MATCHES}: record features that two cameras see together"
        )
    flat = rays(pixels, intrinsics)
    camera_rotation = np.tile(np.eye(3), (cameras, 1, 1))
    camera_translation = np.zeros((cameras, 3))
    both = seen[:, a] & seen[:, b]
    focal = float(intrinsics[[a, b], :2].mean())
    camera_rotation[b], camera_translation[b] = relative_pose(flat[:, a][both], flat[:, b][both], focal)
    placed = np.zeros(cameras, dtype=bool)
    placed[[a, b]] = True
    rotation, translation, structure, posed = align_samples(flat, seen, placed, camera_rotation, camera_translation)
    result = Reconstruction(rotation, translation, structure, camera_rotation, camera_translation, posed, placed)
    return complete(result, pixels, intrinsics)


def complete(found: Reconstruction, pixels: np.ndarray, intrinsics: np.ndarray) -> Reconstruction:
    """Add the cameras, samples and features that can be placed by those that are, and express all in camera 0."""
    flat, seen = rays(pixels, intrinsics), ~np.isnan(pixels[..., 0])
    rotation, translation, structure = found.rotation.copy(), found.translation.copy(), found.structure
    camera_rotation, camera_translation = found.camera_rotation.copy(), found.camera_translation.copy()
    posed, placed = found.posed.copy(), found.placed_cameras.copy()
    views = _Views(flat, seen, placed, camera_rotation, camera_translation)
    structure = _grow(views, structure, rotation, translation, posed)
    for _ in range(len(placed)):
        world = np.einsum("tij,mj->tmi", rotation, structure) + translation[:, None]
        known = posed[:, None] & finite_rows(structure)
        fresh = [c for c in np.flatnonzero(~placed) if (seen[:, c] & known).sum() >= PNP_POINTS]
        if not fresh:
            break
        camera = max(fresh, key=lambda c: (seen[:, c] & known).sum())
        chosen = seen[:, camera] & known
        pose = resect(world[chosen], flat[:, camera][chosen])
        if pose is None:
            break
        camera_rotation[camera], camera_translation[camera] = pose
        placed[camera] = True
        views = _Views(flat, seen, placed, camera_rotation, camera_translation)
        structure = _grow(views, structure, rotation, translation, posed)
    result = Reconstruction(rotation, translation, structure, camera_rotation, camera_translation, posed, placed)
    return in_first_camera(centred(result))


def best_pair(seen: np.ndarray) -> tuple[int, int, int]:
    """The two cameras that saw most features together in ``seen`` (T, c, m), and how many."""
    cameras = seen.shape[1]
    pairs = [(a, b, int((seen[:, a] & seen[:, b]).sum())) for a in range(cameras) for b in range(a + 1, cameras)]
    return max(pairs, key=lambda pair: pair[2]) if pairs else (0, 0, 0)


def relative_pose(first: np.ndarray, second: np.ndarray, focal: float) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the second camera from matched normalised coordinates ``(k, 2)``: first to second, unit translation.

    Two estimates compete by their median Sampson distance: the linear one of all matches, best where none is mistaken,
    and one from random samples.
    """
    candidates = [_linear_essential(first, second)]
    threshold = 2.0 / focal
    sampled, _ = cv2.findEssentialMat(first, second, np.eye(3), cv2.USAC_MAGSAC, 0.999, threshold)
    if sampled is not None:
        candidates += [sampled[k : k + 3] for k in range(0, len(sampled), 3)]
    essential = min(candidates, key=lambda e: np.median(_sampson(e, first, second)))
    distances = _sampson(essential, first, second)
    sound = distances <= 9 * np.median(distances) + 1e-12
    _, rotation, translation, _ = cv2.recoverPose(essential, first[sound], second[sound], np.eye(3))
    return rotation, translation[:, 0]


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


def align_samples(
    flat: np.ndarray, seen: np.ndarray, placed: np.ndarray, camera_rotation: np.ndarray, camera_translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Poses of the samples and structure, from the samples in which placed cameras see features together.

    Args:
        flat: ``(T, c, m, 2)`` normalised coordinates.
        seen: ``(T, c, m)``.
        placed: ``(c,)`` cameras whose pose is known.
        camera_rotation, camera_translation: ``(c, 3, 3)``, ``(c, 3)``.

    Returns:
        rotation ``(T, 3, 3)``, translation ``(T, 3)``, structure ``(m, 3)`` with NaN, posed ``(T,)``.

    Raises:
        DenseVSError: no sample has three features that are not in a line.
    """
    views = _Views(flat, seen, placed, camera_rotation, camera_translation)
    points = views.points
    known = np.isfinite(points[..., 0])
    seeds = [t for t in np.argsort(-known.sum(axis=1), kind="stable")[:4] if _spread(points[t][known[t]]) > 0]
    if not seeds:
        raise DenseVSError(
            "no sample has three features, off a line, that two cameras see together; expected such samples to align"
        )
    best, best_score = None, (-1, np.inf)
    for seed in seeds:
        samples = len(points)
        rotation, translation = np.tile(np.eye(3), (samples, 1, 1)), np.zeros((samples, 3))
        posed = np.arange(samples) == seed
        structure = _grow(views, points[seed].copy(), rotation, translation, posed)
        error = np.linalg.norm(np.einsum("tij,mj->tmi", rotation, structure) + translation[:, None] - points, axis=2)
        error = error[posed]
        score = (int(posed.sum()), float(np.median(error[np.isfinite(error)])))
        if score[0] > 1.1 * best_score[0] or (score[0] > 0.9 * best_score[0] and score[1] < best_score[1]):
            best, best_score = (rotation, translation, structure, posed), score
        if best_score[0] >= 0.95 * samples and best_score[1] < SOUND_ALIGNMENT * np.sqrt(np.nanvar(structure, 0).sum()):
            break
    assert best is not None
    return best


def centred(found: Reconstruction) -> Reconstruction:
    """The same with the structure's origin at its centroid."""
    middle = np.nanmean(found.structure, axis=0)
    found.translation = found.translation + found.rotation @ middle
    found.structure = found.structure - middle
    return found


def in_first_camera(found: Reconstruction) -> Reconstruction:
    """The same in the axes of camera 0 if that is placed, at a scale where the hand is one unit away."""
    reference = 0 if found.placed_cameras[0] else int(np.argmax(found.placed_cameras))
    turn, shift = found.camera_rotation[reference].copy(), found.camera_translation[reference].copy()
    rotation = turn @ found.rotation
    translation = found.translation @ turn.T + shift
    camera_rotation = found.camera_rotation @ turn.T
    camera_translation = found.camera_translation - camera_rotation @ shift
    scale = 1.0 / np.median(np.linalg.norm(translation[found.posed], axis=1))
    return Reconstruction(
        rotation,
        translation * scale,
        found.structure * scale,
        camera_rotation,
        camera_translation * scale,
        found.posed,
        found.placed_cameras,
    )


class _Views:
    """What the placed cameras saw, and the features that they triangulate in each sample."""

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


def _grow(
    views: _Views, structure: np.ndarray, rotation: np.ndarray, translation: np.ndarray, posed: np.ndarray
) -> np.ndarray:
    """Pose sample after sample by the structure known so far, which grows with them; poses are changed in place."""
    size = np.sqrt(np.nanvar(structure, axis=0).sum())

    def pose(t: Any, least: int, least_pnp: int) -> bool:
        chosen = views.known[t] & np.isfinite(structure[:, 0])
        if chosen.sum() >= least and _spread(structure[chosen]) > 0.1 * size:
            rotation[t], translation[t] = _robust_motion(structure[chosen], views.points[t][chosen])
            return True
        visible = views.seen[t] & np.isfinite(structure[:, 0])
        camera = int(np.argmax(visible.sum(axis=1)))
        chosen = visible[camera]
        if chosen.sum() >= least_pnp and _spread(structure[chosen]) > 0.1 * size:
            found = resect(structure[chosen], views.flat[t, camera][chosen])
            if found is not None:
                turn = views.rotation[camera].T
                rotation[t], translation[t] = turn @ found[0], turn @ (found[1] - views.translation[camera])
                return True
        return False

    for least, least_pnp in ((5, 7), (4, 6), (3, 5), (3, 4)) * 3:
        for _ in range(len(posed)):
            fresh = [t for t in np.flatnonzero(~posed) if pose(t, least, least_pnp)]
            if not fresh:
                break
            posed[fresh] = True
            structure = views.structure(rotation, translation, posed)
    for _ in range(3):
        for t in np.flatnonzero(posed):
            pose(t, 4, 7)
        structure = views.structure(rotation, translation, posed)
    return structure


def _robust_motion(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rotation, translation = rigid_motion(source, target)
    if len(source) > 3:
        for _ in range(4):
            error = np.linalg.norm(source @ rotation.T + translation - target, axis=1)
            weight = 1 / (1 + (error / (1.5 * np.median(error) + 1e-12)) ** 2)
            rotation, translation = rigid_motion(source, target, weight)
    return rotation, translation


def _spread(points: np.ndarray) -> float:
    """Second singular value of centred points: zero on a line, or for fewer than three."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(points)))


def _linear_essential(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Normalised eight-point estimate from all matches (Hartley 1997), singular values made 1, 1, 0."""
    (x, a), (y, b) = _conditioned(first), _conditioned(second)
    design = (y[:, :, None] * x[:, None, :]).reshape(-1, 9)
    matrix = np.linalg.svd(design, full_matrices=False)[2][-1].reshape(3, 3)
    left, _, right = np.linalg.svd(b.T @ matrix @ a)
    return left @ np.diag([1.0, 1.0, 0.0]) @ right


def _conditioned(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    middle = points.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(points - middle, axis=1).mean()), 1e-12)
    transform = np.array([[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1]])
    return np.column_stack([(points - middle) * scale, np.ones(len(points))]), transform


def _sampson(essential: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Squared first-order distances to the epipolar constraint."""
    x = np.column_stack([first, np.ones(len(first))])
    y = np.column_stack([second, np.ones(len(second))])
    line, back = x @ essential.T, y @ essential
    slope = (line[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
    return (y * line).sum(axis=1) ** 2 / np.maximum(slope, 1e-300)


def _pnp_errors(points: np.ndarray, normalized: np.ndarray, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    projected = cv2.projectPoints(points, turn, shift, np.eye(3), None)[0][:, 0]
    return np.linalg.norm(projected - normalized, axis=1)
