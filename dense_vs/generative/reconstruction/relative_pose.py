"""The pose of one camera relative to another from features that both saw, without any sample's hand pose.

Beyond the paper's fundamental matrix (Nister 2004): small structures seen in few samples make the linear estimate and
single random ones poor, so that several compete after a robust refinement, and more than one is handed on where they
explain the matches about as well.
"""

from collections.abc import Iterator

import cv2
import numpy as np
from scipy.optimize import least_squares

from dense_vs.generative.least_squares.parameters import turn

MINIMAL_SETS = 40  # of five matches each
REFINED = 6
NOISE_PX = 1.0  # scale of the robust loss
DISTINCT_RAD = 0.05


def relative_poses(
    first: np.ndarray, second: np.ndarray, focal: float, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Poses of the second camera from matched normalised coordinates ``(k, 2)``.

    The first comes from all matches and costs little; those from many small sets follow, most plausible first, for
    whoever finds that it does not do.

    Args:
        first, second: matches of the two cameras.
        focal: length [px], to speak of errors in pixels.
        rng: draws sets of five matches.

    Yields:
        (rotation ``(3, 3)``, unit translation ``(3,)``), first camera to second, each clearly apart from the others.
    """

    def implausible(essential: np.ndarray) -> float:
        return float(np.median(np.abs(_sampson(essential, first, second))))

    usual = [_linear_essential(first, second), *_magsac_essentials(first, second, focal)]
    known = _refined_poses([min(usual, key=implausible)], first, second, focal)
    yield known[0]
    others = sorted([*usual, *_minimal_essentials(first, second, rng)], key=implausible)[:REFINED]
    for pose in _refined_poses(others, first, second, focal):
        if all(_apart(pose, other) > DISTINCT_RAD for other in known):
            known.append(pose)
            yield pose


def _refined_poses(
    essentials: list[np.ndarray], first: np.ndarray, second: np.ndarray, focal: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Refined rotations and translations, most plausible first."""
    refined = [_refined(*_decomposed(one, first, second), first, second, focal) for one in essentials]
    refined.sort(key=lambda one: one[0])
    # Which of the four decompositions stands before both cameras is judged again after the refinement.
    return [_decomposed(_essential(rotation, shift), first, second) for _, rotation, shift in refined]


def _magsac_essentials(first: np.ndarray, second: np.ndarray, focal: float) -> list[np.ndarray]:
    found, _ = cv2.findEssentialMat(first, second, np.eye(3), cv2.USAC_MAGSAC, 0.999, 2.0 / focal)
    return _split(found)


def _minimal_essentials(first: np.ndarray, second: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """All solutions of sets of five matches."""
    essentials = []
    for _ in range(MINIMAL_SETS):
        chosen = rng.choice(len(first), 5, replace=False)
        essentials += _split(cv2.findEssentialMat(first[chosen], second[chosen], np.eye(3), cv2.RANSAC, 0.99, 1.0)[0])
    return essentials


def _split(stack: np.ndarray | None) -> list[np.ndarray]:
    """Solutions that OpenCV stacks."""
    if stack is None or stack.shape[1] != 3:
        return []
    return [stack[k : k + 3] for k in range(0, len(stack), 3) if np.isfinite(stack[k : k + 3]).all()]


def _refined(
    rotation: np.ndarray, translation: np.ndarray, first: np.ndarray, second: np.ndarray, focal: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """Least robust sum of Sampson distances from a start, over the five unknowns; cost, rotation, translation."""
    across = np.linalg.svd(translation[None])[2][1:]

    def pose(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moved = translation + x[3:] @ across
        return turn(x[:3]) @ rotation, moved / np.linalg.norm(moved)

    def residuals(x: np.ndarray) -> np.ndarray:
        return focal * _sampson(_essential(*pose(x)), first, second)

    solution = least_squares(residuals, np.zeros(5), loss="cauchy", f_scale=NOISE_PX, max_nfev=40)
    return float(solution.cost), *pose(solution.x)


def _decomposed(essential: np.ndarray, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The decomposition that puts most of the sound matches before both cameras."""
    distances = _sampson(essential, first, second) ** 2
    sound = distances <= 9 * np.median(distances) + 1e-12
    _, rotation, translation, _ = cv2.recoverPose(essential, first[sound], second[sound], np.eye(3))
    return rotation, translation[:, 0]


def _essential(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    x, y, z = translation
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ rotation


def _apart(pose: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
    """The larger of the angles between rotations and between baselines [rad]."""
    angle = np.arccos(np.clip((np.trace(pose[0] @ other[0].T) - 1) / 2, -1, 1))
    return float(max(angle, np.arccos(np.clip(pose[1] @ other[1], -1, 1))))


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
    """Signed first-order distances to the epipolar constraint."""
    x = np.column_stack([first, np.ones(len(first))])
    y = np.column_stack([second, np.ones(len(second))])
    line, back = x @ essential.T, y @ essential
    slope = (line[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
    return (y * line).sum(axis=1) / np.sqrt(np.maximum(slope, 1e-300))
