"""Stage 1 from one camera: structure and motion of the hand by scaled-orthographic factorization.

Beyond the paper, which starts from two chosen views (incremental structure from motion) and needs many restarts: all
frames take part at once. Features x_tk = A_t F_k + b_t are fitted with rank three though many were not seen (damped
Gauss-Newton, the frames eliminated), the affine frame is made metric by a_x Q a_x = a_y Q a_y, a_x Q a_y = 0 (Tomasi
and Kanade 1992), and depth reversal, which parallel projection can't tell, is left to the caller as two solutions.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.least_squares.levenberg_marquardt import minimize
from dense_vs.generative.least_squares.pixel_problem import NormalEquations
from dense_vs.generative.reconstruction.stereo import Reconstruction, centered
from dense_vs.generative.reconstruction.triangulation import rays

FRAME_FEATURES = 4  # of a frame that takes part
STARTS = 6
FLAT = 1e-3  # share of the widest extent in the images: features without as much in a third direction lie in a plane


def factorize(
    pixels: np.ndarray, intrinsics: np.ndarray, camera: int, rng: np.random.Generator
) -> list[Reconstruction]:
    """Both depth-reversed reconstructions from what one camera saw, in that camera's axes.

    Args:
        pixels: ``(T, c, m, 2)`` of the hand's features.
        intrinsics: ``(c, 6)`` guesses.
        camera: which one.
        rng: draws the starts.

    Raises:
        DenseVSError: fewer than 3 frames with enough features, or features in a plane or line.
    """
    flat = rays(pixels, intrinsics)[:, camera]
    seen = np.isfinite(flat[..., 0])
    frames = seen.sum(axis=1) >= FRAME_FEATURES
    features = (seen & frames[:, None]).sum(axis=0) >= 3
    if frames.sum() < 3 or features.sum() < FRAME_FEATURES:
        raise DenseVSError(
            f"camera {camera} saw {FRAME_FEATURES} or more features of the hand in {int(frames.sum())} samples; "
            "expected at least 3 such samples to find structure and motion from one camera"
        )
    part = flat[frames][:, features]
    frame_axes, shifts, structure = _affine(part, rng)
    # The structure comes with the same extent in every direction: what it lacks, the frames do not show.
    spread = np.linalg.svd(frame_axes.reshape(-1, 3), compute_uv=False)
    if spread[2] < FLAT * spread[0]:
        raise DenseVSError(
            f"the features that camera {camera} saw lie in a plane or line (spread {np.round(spread / spread[0], 4)}); "
            "expected features in three dimensions"
        )
    upgrade = _metric(frame_axes)
    axes = frame_axes @ upgrade
    structure = structure @ np.linalg.inv(upgrade).T
    return [
        _assemble(axes, shifts, structure, mirror, frames, features, pixels.shape, camera) for mirror in (1.0, -1.0)
    ]


@dataclass
class _AffineState:
    structure: np.ndarray  # (m, 3)
    frames: np.ndarray  # (T, 2, 4): A_t and b_t


class _AffineProblem:
    """Squares of x_tk - A_t F_k - b_t over what was seen."""

    def __init__(self, flat: np.ndarray):
        self.seen = np.isfinite(flat[..., 0])
        self.flat = np.where(self.seen[..., None], flat, 0.0)

    def _errors(self, state: _AffineState) -> np.ndarray:
        model = np.einsum("txi,mi->tmx", state.frames[..., :3], state.structure) + state.frames[:, None, :, 3]
        return np.where(self.seen[..., None], model - self.flat, 0.0)

    def cost(self, state: _AffineState) -> float:
        return float((self._errors(state) ** 2).sum())

    def linearize(self, state: _AffineState) -> NormalEquations:
        errors = self._errors(state)
        frames, features = self.seen.shape
        a = state.frames[..., :3]
        weight = self.seen.astype(float)
        products = np.einsum("txi,txj->tij", a, a)
        shared = np.zeros((features, 3, features, 3))
        at = np.arange(features)
        shared[at, :, at] = np.einsum("tm,tij->mij", weight, products)
        extended = np.column_stack([state.structure, np.ones(features)])
        local = np.zeros((frames, 2, 4, 2, 4))
        blocks = np.einsum("tm,mi,mj->tij", weight, extended, extended)
        local[:, 0, :, 0], local[:, 1, :, 1] = blocks, blocks
        coupling = np.einsum("tm,mi,txj->tximj", weight, extended, a)
        return NormalEquations(
            float((errors**2).sum()),
            shared.reshape(3 * features, -1),
            np.einsum("tmx,txi->mi", errors, a).ravel(),
            coupling.reshape(frames, 8, 3 * features),
            local.reshape(frames, 8, 8),
            np.einsum("tmx,mi->txi", errors, extended).reshape(frames, 8),
        )

    def move(self, state: _AffineState, shared: np.ndarray, local: np.ndarray) -> _AffineState:
        return _AffineState(state.structure + shared.reshape(-1, 3), state.frames + local.reshape(-1, 2, 4))


def _affine(flat: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A_t (T, 2, 3), b_t (T, 2) and structure (m, 3), the best of several starts."""
    problem = _AffineProblem(flat)
    size = float(np.nanstd(flat - np.nanmean(flat, axis=1, keepdims=True)))
    best: Any = None  # an _AffineState; minimize() passes on whatever state its problem has
    best_cost = np.inf
    for _ in range(STARTS):
        structure = rng.normal(size=(flat.shape[1], 3))
        frames = np.empty((len(flat), 2, 4))
        for t, seen in enumerate(problem.seen):
            design = np.column_stack([structure[seen], np.ones(seen.sum())])
            frames[t] = np.linalg.lstsq(design, flat[t][seen] / size, rcond=1e-2)[0].T
        start: Any = _AffineState(structure, frames)
        solution = minimize(_AffineProblem(flat / size), start, max_iterations=150, tolerance=1e-5)
        if solution.cost < best_cost:
            best, best_cost = solution.state, solution.cost
    assert best is not None
    found: _AffineState = best
    frames = found.frames * size
    middle = found.structure.mean(axis=0)
    spread = np.linalg.cholesky(np.cov(found.structure.T) + 1e-12 * np.eye(3))  # a round structure: well conditioned
    structure = (found.structure - middle) @ np.linalg.inv(spread).T
    return frames[..., :3] @ spread, frames[..., 3] + frames[..., :3] @ middle, structure


def _metric(frame_axes: np.ndarray) -> np.ndarray:
    """Matrix L (3, 3) that makes the rows of A_t L orthogonal and of one length, least squares over Q = L L^T."""
    rows = []
    for x, y in frame_axes:
        scale = 1 / (x @ x + y @ y)  # a frame counts the same near and far
        rows += [scale * (_form(x, x) - _form(y, y)), 2 * scale * _form(x, y)]
    q = np.linalg.svd(np.array(rows))[2][-1]
    matrix = np.array([[q[0], q[1], q[2]], [q[1], q[3], q[4]], [q[2], q[4], q[5]]])
    matrix *= np.sign(np.trace(matrix))
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.05 * values[2]))


def _form(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients of x Q y in the six entries of symmetric Q."""
    return np.array(
        [
            x[0] * y[0],
            x[0] * y[1] + x[1] * y[0],
            x[0] * y[2] + x[2] * y[0],
            x[1] * y[1],
            x[1] * y[2] + x[2] * y[1],
            x[2] * y[2],
        ]
    )


def _assemble(
    axes: np.ndarray,
    shifts: np.ndarray,
    structure: np.ndarray,
    mirror: float,
    frames: np.ndarray,
    features: np.ndarray,
    shape: tuple[int, ...],
    camera: int,
) -> Reconstruction:
    """Perspective poses with the scale of each frame as its inverse depth."""
    samples, cameras, count = shape[:3]
    flip = np.array([1.0, 1.0, mirror])
    lengths = np.linalg.norm(axes, axis=2)
    depth = 2 / lengths.sum(axis=1)
    scale = 1 / np.median(depth)
    left, _, right = np.linalg.svd(axes, full_matrices=False)
    rows = left @ right
    turn = np.concatenate([rows, np.cross(rows[:, :1], rows[:, 1:])], axis=1)
    turn = flip[:, None] * turn * flip  # turn the other way, of the mirrored structure
    rotation, translation = np.tile(np.eye(3), (samples, 1, 1)), np.tile([0.0, 0.0, 1.0], (samples, 1))
    rotation[frames] = turn
    translation[frames] = scale * np.column_stack([shifts * depth[:, None], depth])
    placed = np.full((count, 3), np.nan)
    placed[features] = scale * structure * flip
    found = Reconstruction(
        rotation,
        translation,
        placed,
        np.tile(np.eye(3), (cameras, 1, 1)),
        np.zeros((cameras, 3)),
        frames.copy(),
        np.arange(cameras) == camera,
    )
    return centered(found)
