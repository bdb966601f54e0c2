"""Relearning one part of a model from a few samples: a camera, the structure, the base or the kinematics.

The paper starts the part from random values and runs L-BFGS with the rest fixed; here each part has a start of its own,
resection, triangulation, rigid alignment or the kinematic stage, so that two to five samples are enough.
"""

import re
import time
from dataclasses import replace

import numpy as np

from dense_vs.checks import shown
from dense_vs.errors import DenseVSError
from dense_vs.generative.inference.pose_inference import infer_poses
from dense_vs.generative.kinematics.placement import CAMERA_POINTS, place_cameras, place_features
from dense_vs.generative.learning.end_to_end import fit_kinematics, fit_pixels, initial_parameters
from dense_vs.generative.learning.expected_error import expected_error
from dense_vs.generative.least_squares.levenberg_marquardt import Solution, minimize
from dense_vs.generative.least_squares.outliers import mistaken, robust_sigma
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.reconstruction.initialization import guessed_intrinsics, intrinsics_prior
from dense_vs.generative.reconstruction.stereo import Reconstruction
from dense_vs.generative.reconstruction.triangulation import rigid_motions
from dense_vs.generative.report import FitReport, Stage

PARTS = "'camera:I', 'structure', 'structure:K,L,...', 'base' or 'kinematics'"
_NUMBER = re.compile("[0-9]{1,9}")
KEPT_INTRINSICS = 0.003  # share of the focal length that a learned lens may be off by when its camera was moved
KEPT_CENTER = 1.0  # px


def relearn(
    parameters: ModelParameters,
    obs: Observations,
    what: str,
    pixel_sigma: float,
    postures: np.ndarray,
    seed: int = 0,
) -> tuple[ModelParameters, FitReport]:
    """New parameters in which only ``what`` differs, from joints and pixels of ``obs``.

    ``postures`` ``(K, n)`` [rad] are those that the model was learned from: the report says what to expect there.

    Raises:
        DenseVSError: ``what`` is no part of the model, or ``obs`` does not determine it.
    """
    started = time.perf_counter()
    kind, _, detail = what.partition(":")
    if obs.joints is None or obs.joints.shape[1] != parameters.joint_count:
        got = None if obs.joints is None else obs.joints.shape
        raise DenseVSError(f"joints have shape {got}; relearning needs (T, {parameters.joint_count})")
    if kind == "camera":
        parameters, solution, problem = _camera(parameters, obs, detail, pixel_sigma)
    elif kind == "structure":
        parameters, solution, problem = _structure(parameters, obs, detail)
    elif kind == "base" and not detail:
        parameters, solution, problem = _base(parameters, obs)
    elif kind == "kinematics" and not detail:
        parameters, solution, problem = _kinematics(parameters, obs, seed)
    else:
        raise DenseVSError(f"what is {what!r}; expected {PARTS}")
    errors = problem.pixel_errors(solution.state)
    used = problem.weights > 0
    seconds = time.perf_counter() - started
    rms = float(np.sqrt(np.mean(errors[used] ** 2) / 2))
    stage = Stage(what, solution.initial_cost, solution.cost, rms, solution.iterations, solution.converged, seconds)
    report = FitReport([stage], rms, float(np.mean(errors[used])), seconds, solution.converged, pixel_sigma=pixel_sigma)
    seen = np.where(problem.seen[..., None], obs.pixels[:, : problem.seen.shape[1]], np.nan)
    report.expected_error_px = expected_error(problem, solution.state, seen, postures, pixel_sigma)
    return parameters, report


def _camera(
    parameters: ModelParameters, obs: Observations, detail: str, pixel_sigma: float
) -> tuple[ModelParameters, Solution, PixelProblem]:
    known, cameras = len(parameters.intrinsics), obs.pixels.shape[1]
    if not _NUMBER.fullmatch(detail) or int(detail) > known or int(detail) >= cameras:
        raise DenseVSError(
            f"what is {shown('camera:' + detail)}; expected camera:0 to camera:{min(known, cameras - 1)}, one past the "
            f"model's {known} cameras for a new one that the pixels have too"
        )
    camera = int(detail)
    fresh = camera == known
    guess = guessed_intrinsics(obs)
    if fresh:
        parameters = replace(
            parameters,
            camera_rotation=np.concatenate([parameters.camera_rotation, np.eye(3)[None]]),
            camera_translation=np.concatenate([parameters.camera_translation, np.full((1, 3), np.nan)]),
            intrinsics=np.concatenate([parameters.intrinsics, guess[camera : camera + 1]]),
        )
    else:
        guess = np.concatenate([parameters.intrinsics, guess[known:]])
    pixels = obs.pixels[:, : len(parameters.intrinsics)]
    which = np.arange(len(parameters.intrinsics)) == camera
    parameters = place_cameras(parameters, pixels, obs.joints, guess, which)
    if not np.isfinite(parameters.camera_translation[camera]).all():
        count = int(np.isfinite(pixels[:, camera, :, 0]).sum())
        raise DenseVSError(
            f"camera {camera} saw {count} features of the model; expected at least {CAMERA_POINTS} to place it"
        )
    own = np.where(which[:, None, None], pixels, np.nan)
    own = np.where(finite_rows(parameters.features)[:, None], own, np.nan)
    if fresh:
        mean, information = intrinsics_prior(obs, guess[: obs.pixels.shape[1]], pixel_sigma)
        mean, information = mean[: len(which)], information[: len(which)]
    else:
        # The lens is the one that was learned: a moved camera keeps its intrinsics but for a little.
        sigma = np.hstack(
            [
                KEPT_INTRINSICS * parameters.intrinsics[:, :2],
                np.full((len(which), 2), KEPT_CENTER),
                np.ones((len(which), 2)),
            ]
        )
        mean, information = parameters.intrinsics.copy(), (pixel_sigma / sigma) ** 2
    free = Free(cameras=which, intrinsics=which)
    problem = PixelProblem(own, parameters.links, parameters.joint_count, free, intrinsics_prior=(mean, information))
    solution = _robust(problem, PixelState(_finite(parameters), obs.joints))
    p = solution.state.parameters
    moved = replace(
        parameters, camera_rotation=p.camera_rotation, camera_translation=p.camera_translation, intrinsics=p.intrinsics
    )
    return moved, solution, problem


def _structure(
    parameters: ModelParameters, obs: Observations, detail: str
) -> tuple[ModelParameters, Solution, PixelProblem]:
    features = obs.pixels.shape[2]
    if detail:
        chosen = detail.split(",")
        if not all(_NUMBER.fullmatch(k) and int(k) < features for k in chosen):
            raise DenseVSError(
                f"what is {shown('structure:' + detail)}; expected whole numbers of features below {features}"
            )
        which = np.isin(np.arange(features), [int(k) for k in chosen])
        if features < len(parameters.features):
            raise DenseVSError(
                f"pixels have {features} features; expected at least the model's {len(parameters.features)}"
            )
    else:
        which = np.ones(features, dtype=bool)
    links = np.full(features, parameters.joint_count) if obs.feature_link is None else obs.feature_link.copy()
    old = np.full((features, 3), np.nan)
    shared = min(features, len(parameters.features))
    if detail:
        old[:shared], links[:shared] = parameters.features[:shared], parameters.links[:shared]
    parameters = replace(parameters, features=old, links=links)
    parameters = place_features(parameters, obs.pixels, obs.joints, which)
    placed = finite_rows(parameters.features) & which
    if not placed.any():
        raise DenseVSError("no feature was seen from two directions; record samples with more motion or more cameras")
    pixels = np.where(placed[:, None], obs.pixels, np.nan)
    problem = PixelProblem(pixels, links, parameters.joint_count, Free(features=placed))
    solution = _robust(problem, PixelState(_finite(parameters), obs.joints))
    features_found = np.where(placed[:, None], solution.state.parameters.features, parameters.features)
    return replace(parameters, features=features_found), solution, problem


def _base(parameters: ModelParameters, obs: Observations) -> tuple[ModelParameters, Solution, PixelProblem]:
    hand = parameters.links == parameters.joint_count
    rotation, translation, rms = infer_poses(parameters, obs.pixels, hand)
    posed = np.flatnonzero(_soundly_posed(rms))
    if len(posed) == 0:
        raise DenseVSError("no sample shows 4 features of the hand to a camera; expected at least one to find the base")
    unmoved = replace(parameters, base_rotation=np.eye(3), base_translation=np.zeros(3))
    hand_points = parameters.features[hand & finite_rows(parameters.features)]
    source, target = [], []
    for t in posed:
        at_rest = _hand_points(unmoved, obs.joints[t], hand_points)
        source.append(at_rest)
        target.append(hand_points @ rotation[t].T + translation[t])
    source, target = np.concatenate(source)[None], np.concatenate(target)[None]
    (turn,), (shift,) = rigid_motions(source, target, np.ones(source.shape[:2]))
    start = replace(parameters, base_rotation=turn, base_translation=shift)
    pixels = np.where(finite_rows(parameters.features)[:, None], obs.pixels, np.nan)
    problem = PixelProblem(pixels, parameters.links, parameters.joint_count, Free(base=True))
    solution = _robust(problem, PixelState(_finite(start), obs.joints))
    p = solution.state.parameters
    return replace(parameters, base_rotation=p.base_rotation, base_translation=p.base_translation), solution, problem


def _kinematics(
    parameters: ModelParameters, obs: Observations, seed: int
) -> tuple[ModelParameters, Solution, PixelProblem]:
    hand = parameters.links == parameters.joint_count
    rotation, translation, rms = infer_poses(parameters, obs.pixels, hand)
    posed = _soundly_posed(rms)
    needed = -(-(4 * parameters.joint_count + 6) // 6)
    if posed.sum() < needed:
        raise DenseVSError(
            f"the hand's pose is known in {int(posed.sum())} samples; {parameters.joint_count} joints need {needed}"
        )
    middle = np.nanmean(parameters.features[hand], axis=0)
    found = Reconstruction(
        rotation,
        np.nan_to_num(translation + rotation @ middle),
        parameters.features - middle,
        parameters.camera_rotation,
        parameters.camera_translation,
        posed,
        np.ones(len(parameters.intrinsics), dtype=bool),
    )
    home = obs.joints.mean(axis=0)
    chains, _ = fit_kinematics(obs.joints - home, found, np.random.default_rng(seed))
    starts = [initial_parameters(chain, found, home, parameters.intrinsics) for chain in chains]
    at_end = hand & finite_rows(parameters.features)
    pixels = np.where(at_end[:, None], obs.pixels, np.nan)
    # The home pose is new, so the features move with it: the cameras alone stay.
    links = np.full(len(hand), parameters.joint_count)
    problem = PixelProblem(pixels, links, parameters.joint_count, Free(kinematics=True, features=at_end))
    solution, _ = fit_pixels(problem, obs.joints, starts)
    solution = _robust(problem, solution.state)
    p = replace(solution.state.parameters, links=parameters.links)
    p = replace(p, features=np.where(at_end[:, None], p.features, np.nan))
    return place_features(p, obs.pixels, obs.joints), solution, problem


def _soundly_posed(rms: np.ndarray) -> np.ndarray:
    """Samples whose pose is known and about as good as the others', from errors ``(T,)`` [px], NaN without a pose."""
    known = np.isfinite(rms)
    return known & (rms < 5 * np.median(rms[known]) + 1.0) if known.any() else known


def _hand_points(parameters: ModelParameters, joints: np.ndarray, points: np.ndarray) -> np.ndarray:
    from dense_vs.generative.prediction import link_poses

    rotation, translation = link_poses(parameters, joints[None])
    return points @ rotation[0, -1].T + translation[0, -1]


def _robust(problem: PixelProblem, state: PixelState) -> Solution:
    """Least squares with mistaken detections left out."""
    behind = problem.seen & ~np.isfinite(problem.pixel_errors(state))
    problem.reweight(np.where(behind, 0.0, 1.0))
    solution = minimize(problem, state, 60)
    errors = problem.pixel_errors(solution.state)
    wrong = mistaken(errors, robust_sigma(errors)) | behind
    if wrong.any() and wrong.sum() < 0.4 * problem.seen.sum():
        problem.reweight((~wrong).astype(float))
        solution = minimize(problem, solution.state, 60)
    return solution


def _finite(parameters: ModelParameters) -> ModelParameters:
    return replace(parameters, features=np.nan_to_num(parameters.features))
