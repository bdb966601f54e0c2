"""Stage 1 from two or more cameras: relative camera pose, triangulation, and the hand's pose in every sample.

The paper's Initialization by Triangulation: essential matrix from the matches of all samples, cheirality, triangulated
features, rigid alignment (Arun et al. 1987). Beyond it, further cameras are resected from the points that are already
known rather than pair by pair, and every step tolerates mistaken labels: medians and reweighting instead of means.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.least_squares.parameters import finite_rows
from dense_vs.generative.reconstruction.relative_pose import relative_poses
from dense_vs.generative.reconstruction.resection import resect
from dense_vs.generative.reconstruction.sample_alignment import Views, align_samples, grow
from dense_vs.generative.reconstruction.triangulation import rays

PAIR_MATCHES = 12  # below, no essential matrix is trusted
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


def reconstruct(pixels: np.ndarray, intrinsics: np.ndarray, rng: np.random.Generator) -> Iterator[Reconstruction]:
    """First estimates from feature pixels ``(T, c, m, 2)`` of the hand and guesses of the intrinsics ``(c, 6)``.

    Most plausible first; one for each pose of the second camera that the matches allow.

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
    both = seen[:, a] & seen[:, b]
    focal = float(intrinsics[[a, b], :2].mean())
    placed = np.zeros(cameras, dtype=bool)
    placed[[a, b]] = True
    for turned, shifted in relative_poses(flat[:, a][both], flat[:, b][both], focal, rng):
        camera_rotation, camera_translation = np.tile(np.eye(3), (cameras, 1, 1)), np.zeros((cameras, 3))
        camera_rotation[b], camera_translation[b] = turned, shifted
        rotation, translation, structure, posed = align_samples(flat, seen, placed, camera_rotation, camera_translation)
        first = Reconstruction(rotation, translation, structure, camera_rotation, camera_translation, posed, placed)
        yield complete(first, pixels, intrinsics)


def complete(found: Reconstruction, pixels: np.ndarray, intrinsics: np.ndarray) -> Reconstruction:
    """Add the cameras, samples and features that can be placed by those that are, and express all in camera 0."""
    flat, seen = rays(pixels, intrinsics), ~np.isnan(pixels[..., 0])
    rotation, translation, structure = found.rotation.copy(), found.translation.copy(), found.structure
    camera_rotation, camera_translation = found.camera_rotation.copy(), found.camera_translation.copy()
    posed, placed = found.posed.copy(), found.placed_cameras.copy()
    views = Views(flat, seen, placed, camera_rotation, camera_translation)
    structure = grow(views, structure, rotation, translation, posed)
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
        views = Views(flat, seen, placed, camera_rotation, camera_translation)
        structure = grow(views, structure, rotation, translation, posed)
    result = Reconstruction(rotation, translation, structure, camera_rotation, camera_translation, posed, placed)
    return in_first_camera(centred(result))


def best_pair(seen: np.ndarray) -> tuple[int, int, int]:
    """The two cameras that saw most features together in ``seen`` (T, c, m), and how many."""
    cameras = seen.shape[1]
    pairs = [(a, b, int((seen[:, a] & seen[:, b]).sum())) for a in range(cameras) for b in range(a + 1, cameras)]
    return max(pairs, key=lambda pair: pair[2]) if pairs else (0, 0, 0)


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
