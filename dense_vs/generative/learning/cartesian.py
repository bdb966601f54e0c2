"""Learning with a Cartesian controller: cameras and structure about the hand's poses.

Noisy poses are Gothoskar (8), minimized by Gothoskar (9); actions are Gothoskar (12), minimized by Gothoskar (13).

There is no kinematics to learn. The reconstruction from images and the poses that were read or commanded differ by a
similarity on the robot's side and a rigid motion on the hand's; both come from relative motions, as in hand-eye
calibration (Park and Martin 1994), and the noise of rotation and translation is estimated as for joints.
"""

import time
from dataclasses import replace

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.learning.state_noise import neighbor_covariance
from dense_vs.generative.least_squares.levenberg_marquardt import Solution, minimize
from dense_vs.generative.least_squares.outliers import list_outliers, mistaken, robust_sigma
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.least_squares.pose_priors import PoseActions, PoseReadings
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.reconstruction.initialization import (
    Candidate,
    candidates,
    guessed_intrinsics,
    intrinsics_prior,
)
from dense_vs.generative.reconstruction.stereo import Reconstruction
from dense_vs.generative.report import FitReport, Stage
from dense_vs.generative.rotations import rotation_vectors

ROUNDS = 10
FIRST_SIGMAS = (0.02, 0.02)  # rad, m
EXACT_SIGMAS = (1e-6, 1e-6)


def fit_cartesian(
    obs: Observations,
    seed: int,
    state: str,
    pixel_sigma: float | None,
    state_sigma: tuple[float, float] | None,
    distortion: int = 0,
) -> tuple[ModelParameters, np.ndarray, FitReport]:
    """Parameters without joints, poses ``(T, 4, 4)`` of the samples, and the report.

    Args:
        obs: with poses for ``state`` ``"observed"`` or ``"noisy"``, with actions ``(T - 1, 4, 4)`` for ``"actions"``.
        seed: of the starts.
        state: which of them.
        pixel_sigma: noise of a coordinate [px], estimated if None.
        state_sigma: noise of rotation [rad] and translation [m], estimated if None.
        distortion: radial coefficients to learn.
    """
    started = time.perf_counter()
    _check_given(obs, state)
    report = FitReport(unused_samples=[int(t) for t in np.flatnonzero(~obs.seen.any(axis=(1, 2)))])
    start, placed = _aligned_start(obs, seed, state, report)
    clock = time.perf_counter()
    sigma = pixel_sigma or 0.5
    prior = intrinsics_prior(obs, guessed_intrinsics(obs), sigma)
    free = Free(features=placed, cameras=True, intrinsics=True, distortion=distortion)
    pixels = np.where(placed[:, None], obs.pixels, np.nan)
    problem = PixelProblem(pixels, start.parameters.links, 0, free, "pose", intrinsics_prior=prior)
    errors = problem.pixel_errors(start)
    scale = max(robust_sigma(errors), 0.5)
    problem.reweight(np.where(np.isfinite(errors), 1 / (1 + (np.nan_to_num(errors) / (4 * scale)) ** 2), 0.0))
    given = EXACT_SIGMAS if state == "observed" else state_sigma
    solution, sigmas = _with_noise(problem, start, obs, state, sigma, given)
    errors = problem.pixel_errors(solution.state)
    sigma = pixel_sigma or robust_sigma(errors)
    wrong = mistaken(np.where(problem.seen & ~np.isfinite(errors), np.inf, errors), robust_sigma(errors))
    problem.reweight((~wrong).astype(float))
    solution, sigmas = _with_noise(problem, solution.state, obs, state, sigma, given or sigmas)
    final = solution.state
    assert final.rotation is not None
    assert final.translation is not None
    errors = problem.pixel_errors(final)
    used = problem.weights > 0
    report.rms_px = float(np.sqrt(np.mean(errors[used] ** 2) / 2))
    report.mean_error_px = float(np.mean(errors[used]))
    report.pixel_sigma, report.pose_sigma = robust_sigma(np.where(used, errors, np.nan)), sigmas
    report.converged = solution.converged
    report.stages.append(_stage("end to end", solution, report.rms_px, time.perf_counter() - clock))
    poses = np.tile(np.eye(4), (len(obs), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = final.rotation, final.translation
    problem.reweight(np.ones(used.shape))
    modeled = obs.pixels + np.where(problem.seen[..., None], problem.residuals(final), np.nan)
    report.outliers, report.swapped = list_outliers(obs.pixels, modeled, problem.seen & ~used, report.pixel_sigma)
    counts = used.sum(axis=(0, 1))
    report.unobservable = [
        f"feature {k} was seen in {counts[k]} usable images: its place is unknown"
        for k in range(len(counts))
        if not placed[k] or counts[k] < 2
    ]
    learned = final.parameters.copy()
    learned.features[~placed | (counts < 2)] = np.nan
    report.seconds = time.perf_counter() - started
    return learned, poses, report


def _check_given(obs: Observations, state: str) -> None:
    if state == "actions" and (obs.actions is None or obs.actions.ndim != 3):
        got = "None" if obs.actions is None else f"shape {obs.actions.shape}"
        raise DenseVSError(f"state 'actions' of a Cartesian controller needs actions of shape (T - 1, 4, 4); got {got}")
    if state != "actions" and obs.poses is None:
        raise DenseVSError(f"state {state!r} of a Cartesian controller needs poses of shape (T, 4, 4); got None")
    blind = np.flatnonzero(~obs.seen.any(axis=(0, 2)))
    if len(blind):
        raise DenseVSError(f"camera {blind[0]} saw no feature in any of the {len(obs)} samples; leave it out")


def _aligned_start(obs: Observations, seed: int, state: str, report: FitReport) -> tuple[PixelState, np.ndarray]:
    """Reconstruction from the images, in the robot's frame, and which features ``(m,)`` it placed; adds its stages."""
    clock = time.perf_counter()
    hand = np.ones(obs.pixels.shape[2], dtype=bool)
    found = candidates(obs, hand, np.random.default_rng(seed))
    reconstructed = time.perf_counter()
    aligned = [_aligned(candidate, obs, state) for candidate in found]
    best = min(range(len(found)), key=lambda k: aligned[k][1])
    candidate, ((rotation, translation, features, turns, shifts), error, before) = found[best], aligned[best]
    done = time.perf_counter()
    report.stages.append(_stage("cameras and structure", candidate.solution, candidate.rms, reconstructed - clock))
    report.stages.append(Stage("alignment", before, error, error, 0, True, done - reconstructed))
    parameters = ModelParameters(
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros(0),
        np.nan_to_num(features),
        np.zeros(len(features), int),
        turns,
        shifts,
        candidate.intrinsics,
    )
    return PixelState(parameters, np.zeros((len(obs), 0)), rotation, translation), finite_rows(features)


def _stage(name: str, solution: Solution, rms: float, seconds: float) -> Stage:
    return Stage(name, solution.initial_cost, solution.cost, rms, solution.iterations, solution.converged, seconds)


def align_frames(
    found: Reconstruction, first: np.ndarray, second: np.ndarray, motions: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Rotation, scale and shift from the reconstruction's world to the robot's.

    Args:
        found: poses by images.
        first, second: ``(k,)`` samples between which the robot moved by
        motions: ``(k, 4, 4)``, P_second = motion P_first in the robot's frame.

    Raises:
        DenseVSError: no rotation about two different axes, which leaves the frames' relation open.
    """
    sound = found.posed[first] & found.posed[second]
    first, second, motions = first[sound], second[sound], motions[sound]
    relative = found.rotation[second] @ found.rotation[first].swapaxes(1, 2)
    seen, done = rotation_vectors(relative), rotation_vectors(motions[:, :3, :3])
    spread = np.linalg.svd(done, compute_uv=False) if len(done) > 1 else np.zeros(3)
    if len(spread) < 2 or spread[1] < 0.02 * np.sqrt(len(done)):
        raise DenseVSError(
            "the hand turned about one axis at most between samples whose pose is known; "
            "expected turns about two axes, or the cameras cannot be tied to the robot's frame"
        )
    weights = np.ones(len(seen))
    turn = np.eye(3)
    for _ in range(5):
        left, _, right = np.linalg.svd((weights[:, None] * done).T @ seen)
        turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
        errors = np.linalg.norm(done - seen @ turn.T, axis=1)
        weights = 1 / (1 + (errors / (2 * np.median(errors) + 1e-9)) ** 2)
    shift = found.translation[second] - np.einsum("kij,kj->ki", relative, found.translation[first])
    design = np.concatenate([(shift @ turn.T)[..., None], np.eye(3) - motions[:, :3, :3]], axis=2)
    right_side = motions[:, :3, 3]
    for _ in range(5):
        root = np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq((design * root[..., None]).reshape(-1, 4), (right_side * root).ravel(), rcond=None)[
            0
        ]
        errors = np.linalg.norm(design @ solution - right_side, axis=1)
        weights = 1 / (1 + (errors / (2 * np.median(errors) + 1e-9)) ** 2)
    return turn, float(solution[0]), solution[1:]


def _aligned(candidate: Candidate, obs: Observations, state: str) -> tuple[tuple[np.ndarray, ...], float, float]:
    """Poses, features and cameras of a candidate in the robot's frame; how far rotations are off, and were [rad]."""
    found = candidate.found
    samples = len(obs)
    if state == "actions":
        first, second, motions = np.arange(samples - 1), np.arange(1, samples), obs.actions
    else:
        first = np.concatenate([np.arange(samples), np.arange(samples)])
        second = np.concatenate([(np.arange(samples) + 1) % samples, (np.arange(samples) + samples // 2) % samples])
        motions = obs.poses[second] @ np.linalg.inv(obs.poses[first])
    turn, scale, shift = align_frames(found, first, second, motions)
    if scale <= 0:
        scale = abs(scale) + 1e-6
    rotation = turn @ found.rotation
    translation = scale * found.translation @ turn.T + shift
    features = scale * found.structure
    if state != "actions":
        posed = found.posed
        inside = rotation[posed].swapaxes(1, 2)
        rest = inside @ obs.poses[posed][:, :3, :3]
        left, _, right = np.linalg.svd(rest.sum(axis=0))
        grip = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
        place = np.median(np.einsum("tij,tj->ti", inside, obs.poses[posed][:, :3, 3] - translation[posed]), axis=0)
        translation = translation + rotation @ place
        rotation = rotation @ grip
        features = (features - place) @ grip
        off = rotation_vectors(rotation[posed] @ obs.poses[posed][:, :3, :3].swapaxes(1, 2))
        lost = ~posed
        rotation[lost], translation[lost] = obs.poses[lost][:, :3, :3], obs.poses[lost][:, :3, 3]
    else:
        relative = rotation[1:] @ rotation[:-1].swapaxes(1, 2)
        off = rotation_vectors(relative @ obs.actions[:, :3, :3].swapaxes(1, 2))
        _carry_on(found.posed, obs.actions, rotation, translation)
    turns = found.camera_rotation @ turn.T
    shifts = scale * found.camera_translation - turns @ shift
    error, before = (np.median(np.linalg.norm(v, axis=1)) for v in (off, rotation_vectors(motions[:, :3, :3])))
    return (rotation, translation, features, turns, shifts), float(error), float(before)


def _carry_on(posed: np.ndarray, actions: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> None:
    """Poses of samples without one from a neighbor's and the action between, in place."""
    known = posed.copy()
    for _ in range(len(known)):
        fresh = np.flatnonzero(~known)
        if len(fresh) == 0:
            return
        for t in fresh:
            if t > 0 and known[t - 1]:
                a = actions[t - 1]
                rotation[t], translation[t] = a[:3, :3] @ rotation[t - 1], a[:3, :3] @ translation[t - 1] + a[:3, 3]
                known[t] = True
            elif t + 1 < len(known) and known[t + 1]:
                a = np.linalg.inv(actions[t])
                rotation[t], translation[t] = a[:3, :3] @ rotation[t + 1], a[:3, :3] @ translation[t + 1] + a[:3, 3]
                known[t] = True


def _with_noise(
    problem: PixelProblem,
    state: PixelState,
    obs: Observations,
    kind: str,
    pixel_sigma: float,
    given: tuple[float, float] | None,
) -> tuple[Solution, tuple[float, float]]:
    """Gothoskar (9) or Gothoskar (13): poses tied to readings or actions, their noise by expectation maximization."""

    def make(information: tuple[float, float]) -> PoseReadings | PoseActions:
        return PoseActions(obs.actions, information) if kind == "actions" else PoseReadings(obs.poses, information)

    sigmas = given or FIRST_SIGMAS
    solution, iterations, seconds = None, 0, 0.0
    for _ in range(1 if given else ROUNDS):
        prior = make(((pixel_sigma / sigmas[0]) ** 2, (pixel_sigma / sigmas[1]) ** 2))
        problem.prior = prior
        solution = minimize(problem, state, 60, tolerance=1e-6)
        state, iterations, seconds = solution.state, iterations + solution.iterations, seconds + solution.seconds
        if given:
            break
        equations = problem.linearize(state)
        assert equations.local is not None
        chained = np.zeros((len(obs) - 1, 6, 6)) if equations.chained is None else equations.chained
        own, across = neighbor_covariance(equations.local, chained)
        mean_square = prior.deviations(state) ** 2 + pixel_sigma**2 * prior.spread(state, own, across)
        fresh = (
            max(float(np.sqrt(mean_square[:, :3].mean())), 1e-6),
            max(float(np.sqrt(mean_square[:, 3:].mean())), 1e-6),
        )
        settled = all(abs(new - old) < 0.02 * old for new, old in zip(fresh, sigmas, strict=True))
        sigmas = fresh
        if settled:
            break
    assert solution is not None
    return replace(solution, iterations=iterations, seconds=seconds), sigmas
