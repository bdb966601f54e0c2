"""Stage 1, refined: bundle adjustment of the hand's poses, the structure and the cameras.

The loss is Gothoskar (2), its minimum Gothoskar (3).
"""

import numpy as np

from dense_vs.generative.least_squares.levenberg_marquardt import Solution, minimize
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.reconstruction.pose_reversal import better_poses
from dense_vs.generative.reconstruction.stereo import Reconstruction


def adjust_bundle(
    pixels: np.ndarray,
    intrinsics: np.ndarray,
    found: Reconstruction,
    max_iterations: int = 30,
    intrinsics_prior: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[Reconstruction, np.ndarray, Solution, np.ndarray]:
    """Least reprojection error from ``found``.

    Args:
        pixels: ``(T, c, m, 2)`` of the hand's features.
        intrinsics: ``(c, 6)``; unknown too if they have a prior.
        found: where to start; only its placed cameras, features and posed samples take part.
        max_iterations: steps of each of the rounds.
        intrinsics_prior: as :class:`PixelProblem` takes it.

    Returns:
        The adjusted reconstruction, the intrinsics, the solver's result and the weights ``(T, c, m)`` of the last
        round, which fall where an error is several times the usual one.
    """
    features = finite_rows(found.structure)
    part = np.where((found.posed[:, None, None] & found.placed_cameras[:, None] & features)[..., None], pixels, np.nan)
    cameras = found.placed_cameras.copy()
    cameras[int(np.argmax(cameras))] = False  # the first one is the world
    free = Free(features=features, cameras=cameras, intrinsics=intrinsics_prior is not None)
    problem = PixelProblem(part, np.zeros(len(features), int), 0, free, "pose", intrinsics_prior=intrinsics_prior)
    parameters = ModelParameters(
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros(0),
        np.nan_to_num(found.structure),
        np.zeros(len(features), int),
        found.camera_rotation,
        found.camera_translation,
        intrinsics,
    )
    state = PixelState(parameters, np.zeros((len(pixels), 0)), found.rotation, found.translation)
    behind = ~np.isfinite(problem.residuals(state)).all(axis=-1)
    if behind.any():
        problem.seen &= ~behind
    weights = problem.seen.astype(float)
    solution = None
    initial = None
    for rounds in range(2):
        weights = robust_weights(problem.pixel_errors(state))
        if rounds > 0 and (weights[problem.seen] > 0.9).all():
            break  # nothing stands out: the rounds before were least squares already
        problem.reweight(np.where(problem.seen, weights, 0.0))
        solution = minimize(problem, state, max_iterations, tolerance=1e-6)
        initial = solution.initial_cost if initial is None else initial
        state = solution.state
    assert solution is not None
    state, reversed_samples = better_poses(_poses_alone(problem, part), state)
    if reversed_samples.any():
        problem.reweight(np.where(problem.seen, robust_weights(problem.pixel_errors(state)), 0.0))
        solution = minimize(problem, state, max_iterations, tolerance=1e-6)
        state, weights = solution.state, problem.weights
    assert state.rotation is not None
    assert state.translation is not None
    solution.initial_cost = float(initial or 0.0)
    p = state.parameters
    structure = np.where(features[:, None], p.features, np.nan)
    adjusted = Reconstruction(
        state.rotation,
        state.translation,
        structure,
        p.camera_rotation,
        p.camera_translation,
        found.posed,
        found.placed_cameras,
    )
    return adjusted, p.intrinsics, solution, weights


def _poses_alone(problem: PixelProblem, pixels: np.ndarray) -> PixelProblem:
    """The same with everything known but the samples' poses."""
    alone = PixelProblem(pixels, problem.links, 0, Free(), "pose")
    alone.seen &= problem.seen
    alone.reweight(problem.weights)
    return alone


def robust_weights(errors: np.ndarray, factor: float = 4.0, floor: float = 0.5) -> np.ndarray:
    """Cauchy weights ``1 / (1 + (e / (factor s))^2)`` of distances in px, s their median over that of a Rayleigh law.

    Args:
        errors: any shape, NaN where there is none (weight 0).
        factor: errors of this many scales get half the weight.
        floor: least scale [px]: differences below the pixel noise are not outliers.
    """
    known = np.isfinite(errors)
    if not known.any():
        return np.zeros(errors.shape)
    scale = max(float(np.median(errors[known])) / 1.1774, floor)
    return np.where(known, 1 / (1 + (np.nan_to_num(errors) / (factor * scale)) ** 2), 0.0)
