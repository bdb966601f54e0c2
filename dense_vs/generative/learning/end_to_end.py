"""Stages 2 and 3 for states that are read: kinematics from the hand's poses, then everything from the pixels.

Gothoskar (4), Gothoskar (5) by other means and Gothoskar (6), Gothoskar (7): directions of the axes from rotations
alone, their places by linear least squares, then Levenberg-Marquardt over all shared parameters with the full data.
Where that ends above what the pixels allow, the next distinct minimum of the rotations is tried.
"""

import time
from dataclasses import dataclass

import numpy as np

from dense_vs.generative.kinematics.axis_points import fit_axis_points
from dense_vs.generative.kinematics.rotation_fit import fit_rotations_robustly, rotation_errors
from dense_vs.generative.least_squares.levenberg_marquardt import Solution, minimize
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.reconstruction.stereo import Reconstruction
from dense_vs.generative.report import Stage

GOOD_RMS = 2.0  # px, of a coordinate: above, another minimum is looked for


@dataclass
class KinematicFit:
    """A chain that follows the reconstructed poses: lines in the home pose, and the hand's home pose."""

    axes: np.ndarray
    points: np.ndarray
    home_rotation: np.ndarray
    home_translation: np.ndarray
    rms: float  # rad


def fit_kinematics(
    joints: np.ndarray, found: Reconstruction, rng: np.random.Generator, starts: int = 24
) -> tuple[list[KinematicFit], Stage]:
    """Chains for the poses of ``found``, one a minimum, best first: stage 2, Gothoskar (5).

    Args:
        joints: ``(T, n)`` [rad] from the home pose.
        found: the hand's poses; only posed samples take part.
        rng: draws starts.
        starts: of the rotation fit.
    """
    started = time.perf_counter()
    q, rotation, translation = joints[found.posed], found.rotation[found.posed], found.translation[found.posed]
    fits = []
    for minimum in fit_rotations_robustly(q, rotation, rng, starts=starts):
        errors = rotation_errors(q, rotation, minimum.axes, minimum.home)
        weights = 1 / (1 + (errors / (2 * minimum.rms + 1e-6)) ** 2) ** 2
        points, place = fit_axis_points(q, minimum.axes, translation, weights)
        fits.append(KinematicFit(minimum.axes, points, minimum.home, place, minimum.rms))
    mean = fits[0].home_rotation
    initial = float((rotation_errors(np.zeros_like(q), rotation, fits[0].axes, mean) ** 2).sum())
    loss = float((rotation_errors(q, rotation, fits[0].axes, fits[0].home_rotation) ** 2).sum())
    stage = Stage("kinematics", initial, loss, fits[0].rms, 0, True, time.perf_counter() - started)
    return fits, stage


def initial_parameters(
    fit: KinematicFit, found: Reconstruction, home: np.ndarray, intrinsics: np.ndarray
) -> ModelParameters:
    """Model parameters put together from a reconstruction and a chain."""
    features = np.nan_to_num(found.structure) @ fit.home_rotation.T + fit.home_translation
    return ModelParameters(
        fit.axes,
        fit.points,
        home,
        features,
        np.full(len(features), len(fit.axes)),
        found.camera_rotation,
        found.camera_translation,
        intrinsics,
    )


def fit_pixels(
    problem: PixelProblem, joints: np.ndarray, candidates: list[ModelParameters], max_iterations: int = 100
) -> tuple[Solution, int]:
    """Stage 3, Gothoskar (7), from each candidate until one explains the pixels; the best solution and its number."""
    best, which = None, -1
    for number, parameters in enumerate(candidates):
        solution = minimize(problem, PixelState(parameters, joints), max_iterations)
        if best is None or solution.cost < best.cost:
            best, which = solution, number
        if coordinate_rms(problem, best.cost) < GOOD_RMS:
            break
    assert best is not None
    return best, which


def coordinate_rms(problem: PixelProblem, cost: float) -> float:
    """Root mean square of a pixel coordinate [px]."""
    return float(np.sqrt(cost / max(2.0 * problem.weights.sum(), 1.0)))


def all_shared(cameras: np.ndarray, distortion: int = 0) -> Free:
    """Everything free but the pose of the first placed camera ``(c,)``, which is the world."""
    poses = cameras.copy()
    poses[int(np.argmax(cameras))] = False
    return Free(kinematics=True, features=True, cameras=poses, intrinsics=cameras, distortion=distortion)
