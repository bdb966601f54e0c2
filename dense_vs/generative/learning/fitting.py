"""Learning in stages, as the paper does: cameras and structure, kinematics, everything end to end, then the noise."""

import time
from dataclasses import dataclass, replace

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg, DHProblem, DHState, from_lines, with_dh
from dense_vs.generative.kinematics.placement import place_cameras, place_features
from dense_vs.generative.learning.end_to_end import (
    all_shared,
    coordinate_rms,
    fit_kinematics,
    fit_pixels,
    initial_parameters,
)
from dense_vs.generative.learning.expected_error import expected_error, unexplained_distance
from dense_vs.generative.learning.state_noise import fit_noisy_actions, fit_noisy_readings
from dense_vs.generative.least_squares.levenberg_marquardt import Solution, minimize
from dense_vs.generative.least_squares.observability import describe_unobservable
from dense_vs.generative.least_squares.outliers import list_outliers, mistaken, robust_sigma
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters, finite_rows
from dense_vs.generative.reconstruction.initialization import (
    Candidate,
    candidates,
    guessed_intrinsics,
    intrinsics_prior,
)
from dense_vs.generative.report import MOST_MISFIT, MOST_NOISE, FitReport, Stage

STILL = 1e-6  # rad of range: below, a joint did not move
REJECTION_ROUNDS = 4


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit; see :meth:`GenerativeModel.fit`."""

    state: str = "observed"
    pixel_sigma: float | None = None
    state_sigma: float | None = None
    proportional_noise: bool = False
    distortion: int = 0
    kinematics: str = "poe"


@dataclass
class Fit:
    """Parameters, the joints ``(T, n)`` of the samples as the model sees them, and the report."""

    parameters: ModelParameters
    joints: np.ndarray
    report: FitReport
    dh: DenavitHartenberg | None = None


def fit_joint_model(obs: Observations, seed: int, options: FitOptions) -> Fit:
    """The model of an arm whose joints, noisy joints or joint actions are known."""
    started = time.perf_counter()
    rng = np.random.default_rng(seed)
    joints = first_joints(obs, options.state)
    count = joints.shape[1]
    links = np.full(obs.pixels.shape[2], count) if obs.feature_link is None else obs.feature_link
    _check_sufficient(obs, links, count)
    report = FitReport(still_joints=[int(i) + 1 for i in np.flatnonzero(np.ptp(joints, axis=0) < STILL)])
    report.unused_samples = [int(t) for t in np.flatnonzero(~obs.seen.any(axis=(1, 2)))]
    clock = time.perf_counter()
    found = candidates(obs, links == count, rng)
    pixel_sigma = options.pixel_sigma or _bundle_sigma(found[0])
    first = found[0].solution
    report.stages.append(
        Stage(
            "cameras and structure",
            first.initial_cost,
            first.cost,
            found[0].rms,
            first.iterations,
            first.converged,
            time.perf_counter() - clock,
        )
    )
    clock = time.perf_counter()
    home = joints.mean(axis=0)
    starts, stage = _assemble(found, joints, home, rng)
    report.stages.append(replace(stage, seconds=time.perf_counter() - clock))
    clock = time.perf_counter()
    guess = guessed_intrinsics(obs)
    parameters, solution = _from_hand(obs, links, joints, starts, options, guess, pixel_sigma)
    parameters = _add_rest(obs, links, joints, parameters, guess)
    problem = _problem(obs, links, parameters, joints, options, guess, pixel_sigma)
    start = PixelState(parameters, joints)
    if options.kinematics == "dh":
        start = with_dh(start, from_lines(parameters.axes, parameters.points, parameters.home))
    best = minimize(_in_coordinates(problem, options), start, 60)
    if options.state == "observed":
        best = _reject(problem, best, options)
    report.stages.append(_stage("end to end", best, problem, clock, solution))
    if options.state != "observed":
        clock = time.perf_counter()
        best, report.joint_sigma, problem = _with_noise(obs, links, best, options, guess, pixel_sigma, problem.weights)
        report.stages.append(_stage("noise of the state", best, problem, clock))
    _finish(report, obs, problem, best, options)
    if options.state != "actions":
        state = best.state
        report.misfit = report.rms_px / (options.pixel_sigma or min(pixel_sigma, MOST_NOISE))
        report.converged = report.converged and report.misfit <= MOST_MISFIT
        known = expected_error(problem, state, obs.pixels, state.joints, max(pixel_sigma, report.rms_px))
        report.expected_error_px = float(np.hypot(known, unexplained_distance(report.rms_px, pixel_sigma)))
    report.seconds = time.perf_counter() - started
    dh = best.state.dh if isinstance(best.state, DHState) else None
    return Fit(_without_unseen(best.state.parameters, problem), best.state.joints, report, dh)


def _in_coordinates(problem: PixelProblem, options: FitOptions) -> PixelProblem | DHProblem:
    """The problem in the kinematic parameters that were asked for."""
    return DHProblem(problem) if options.kinematics == "dh" else problem


def first_joints(obs: Observations, state: str) -> np.ndarray:
    """Joints as read, or the actions added up from zero."""
    if state == "actions":
        if obs.actions is None or obs.actions.ndim != 2:
            got = "None" if obs.actions is None else f"shape {obs.actions.shape}"
            raise DenseVSError(f"state 'actions' of a joint controller needs actions of shape (T - 1, n); got {got}")
        return np.concatenate([np.zeros((1, obs.actions.shape[1])), np.cumsum(obs.actions, axis=0)])
    if obs.joints is None:
        raise DenseVSError(f"state {state!r} of a joint controller needs joints of shape (T, n); got None")
    return obs.joints


def _check_sufficient(obs: Observations, links: np.ndarray, joint_count: int) -> None:
    """Refuse what cannot determine the model by counting."""
    seen = obs.seen
    blind = np.flatnonzero(~seen.any(axis=(0, 2)))
    if len(blind):
        raise DenseVSError(f"camera {blind[0]} saw no feature in any of the {len(obs)} samples; leave it out")
    hand = links == joint_count
    shown = int((seen.any(axis=(0, 1)) & hand).sum())
    if shown < 4:
        raise DenseVSError(
            f"{shown} features of the last link (feature_link = {joint_count}) were seen; expected at least 4 for its "
            "poses"
        )
    useful = int((seen[:, :, hand].sum(axis=2).max(axis=1) >= 3).sum())
    needed = -(-(4 * joint_count + 6) // 6)
    if useful < needed:
        raise DenseVSError(
            f"{useful} samples show 3 or more features of the hand to a camera; {joint_count} joints need at least "
            f"{needed}"
        )
    cameras, features = seen.shape[1], int(seen.any(axis=(0, 1)).sum())
    unknowns = 4 * joint_count + 3 * features + 6 * (cameras - 1) + 4 * cameras - 1
    equations = 2 * int(seen.sum())
    if equations < unknowns:
        raise DenseVSError(
            f"{equations} pixel coordinates were seen for {unknowns} unknowns; record more samples or features"
        )


def _bundle_sigma(candidate: Candidate) -> float:
    """Noise of a pixel coordinate [px] from the bundle adjustment, free of joints."""
    found = candidate.found
    taken = candidate.weights > 0
    unknowns = 6 * found.posed.sum() + 3 * np.isfinite(found.structure[:, 0]).sum() + 6 * found.placed_cameras.sum()
    degrees = 2 * int(taken.sum()) - int(unknowns)
    if degrees < 20:
        return 0.5
    return float(np.clip(np.sqrt(candidate.solution.cost / degrees), 0.05, 5.0))


def _assemble(
    found: list[Candidate], joints: np.ndarray, home: np.ndarray, rng: np.random.Generator
) -> tuple[list, Stage]:
    """Starts of the end-to-end stage, (parameters, weights, cameras, features), best kinematics first; their report."""
    starts = []
    for candidate in found:
        if candidate.found.posed.sum() < 3:
            continue
        chains, stage = fit_kinematics(joints - home, candidate.found, rng)
        for chain in chains:
            start = initial_parameters(chain, candidate.found, home, candidate.intrinsics)
            placed = candidate.found.placed_cameras
            features = np.isfinite(candidate.found.structure[:, 0])
            starts.append((chain.rms, start, candidate.weights, placed, features, stage))
    if not starts:
        raise DenseVSError(
            "the hand's pose is known in fewer than 3 samples; record features that stay visible as the arm moves"
        )
    starts.sort(key=lambda start: (-start[3].sum(), start[0]))
    return [start[1:5] for start in starts], starts[0][5]


def _from_hand(
    obs: Observations,
    links: np.ndarray,
    joints: np.ndarray,
    starts: list,
    options: FitOptions,
    guess: np.ndarray,
    pixel_sigma: float,
) -> tuple[ModelParameters, Solution]:
    """End to end with what stage 1 placed: features of the hand, placed cameras, plausible detections."""
    best, chosen = None, None
    count = joints.shape[1]
    for number, (parameters, weights, cameras, features) in enumerate(starts):
        usable = np.where(weights > 0, weights, 1.0) * cameras[:, None] * features
        free = all_shared(cameras, options.distortion)
        free = replace(free, features=features)
        prior = intrinsics_prior(obs, guess, pixel_sigma)
        problem = PixelProblem(
            obs.pixels, np.full(len(links), count), count, free, intrinsics_prior=prior, weights=usable
        )
        solution, _ = fit_pixels(problem, joints, [parameters])
        if best is None or solution.cost < best.cost:
            best, chosen = solution, (cameras, features)
        rms = coordinate_rms(problem, best.cost)
        good = 2.0 if options.state == "observed" else 4.0
        if rms < good or number >= 7:
            break
    assert best is not None
    assert chosen is not None
    if not np.isfinite(best.cost):
        raise DenseVSError(
            "learning diverged: no start of the end-to-end stage puts the features in front of their cameras; expected "
            "focal lengths and centers that are about right"
        )
    parameters = best.state.parameters.copy()
    parameters.features[~chosen[1]] = np.nan
    parameters.camera_translation[~chosen[0]] = np.nan
    return parameters, best


def _add_rest(
    obs: Observations, links: np.ndarray, joints: np.ndarray, parameters: ModelParameters, guess: np.ndarray
) -> ModelParameters:
    """Features of other links and whatever stage 1 left out, placed through the chain."""
    parameters = replace(parameters, links=links)
    for _ in range(2):
        parameters = place_features(parameters, obs.pixels, joints)
        parameters = place_cameras(parameters, obs.pixels, joints, guess)
    if not np.isfinite(parameters.camera_translation).all():
        lost = np.flatnonzero(~finite_rows(parameters.camera_translation))
        raise DenseVSError(
            f"camera {lost[0]} saw too few features that other cameras saw too; expected at least 4 detections of them"
        )
    return parameters


def _problem(
    obs: Observations,
    links: np.ndarray,
    parameters: ModelParameters,
    joints: np.ndarray,
    options: FitOptions,
    guess: np.ndarray,
    pixel_sigma: float,
    local: str = "none",
) -> PixelProblem:
    """Everything free, with weights that tolerate mistakes at first."""
    cameras = np.ones(obs.pixels.shape[1], dtype=bool)
    features = finite_rows(parameters.features)
    free: Free = replace(all_shared(cameras, options.distortion), features=features)
    prior = intrinsics_prior(obs, guess, pixel_sigma)
    problem = PixelProblem(
        np.where(features[:, None], obs.pixels, np.nan), links, joints.shape[1], free, local, intrinsics_prior=prior
    )
    parameters.features[~features] = 0.0
    errors = problem.pixel_errors(PixelState(parameters, joints))
    ahead = np.isfinite(errors)
    scale = max(robust_sigma(errors), 0.5)
    problem.reweight(np.where(ahead, 1 / (1 + (np.nan_to_num(errors) / (4 * scale)) ** 2), 0.0))
    return problem


def _reject(problem: PixelProblem, solution: Solution, options: FitOptions) -> Solution:
    """Least squares of the sound detections: mistaken ones lose all weight, the others get theirs back."""
    before = None
    for _ in range(REJECTION_ROUNDS):
        errors = problem.pixel_errors(solution.state)
        errors = np.where(problem.seen & ~np.isfinite(errors), np.inf, errors)
        wrong = mistaken(errors, robust_sigma(errors))
        if before is not None and (wrong == before).all():
            break
        problem.reweight((~wrong).astype(float))
        again = minimize(_in_coordinates(problem, options), solution.state, 60)
        solution = replace(again, iterations=solution.iterations + again.iterations)
        before = wrong
    return solution


def _with_noise(
    obs: Observations,
    links: np.ndarray,
    solution: Solution,
    options: FitOptions,
    guess: np.ndarray,
    pixel_sigma: float,
    weights: np.ndarray,
) -> tuple[Solution, float, PixelProblem]:
    """The joints of the samples made unknown, tied to their readings or to the actions."""
    state = solution.state
    problem = _problem(obs, links, state.parameters, state.joints, options, guess, pixel_sigma, "joints")
    posed = _in_coordinates(problem, options)
    for attempt in range(2):
        if options.state == "noisy":
            best, sigma = fit_noisy_readings(posed, state, obs.joints, pixel_sigma, options.state_sigma)
        else:
            best, sigma = fit_noisy_actions(
                posed, state, obs.actions, pixel_sigma, options.state_sigma, options.proportional_noise
            )
        state = best.state
        if attempt == 0:
            best = _reject(problem, best, options)
            state = best.state
    return best, sigma, problem


def _finish(report: FitReport, obs: Observations, problem: PixelProblem, best: Solution, options: FitOptions) -> None:
    """Figures, outliers and what stayed open."""
    errors = problem.pixel_errors(best.state)
    used = problem.weights > 0
    report.rms_px = float(np.sqrt(np.mean(errors[used] ** 2) / 2))
    report.mean_error_px = float(np.mean(errors[used]))
    report.converged = best.converged
    sigma = robust_sigma(np.where(used, errors, np.nan))
    report.pixel_sigma = sigma
    from dense_vs.generative.prediction import predict

    modeled = predict(best.state.parameters, best.state.joints)
    report.outliers, report.swapped = list_outliers(obs.pixels, modeled, problem.seen & ~used, sigma)
    report.unobservable = describe_unobservable(problem, best.state, options.state == "actions", report.still_joints)


def _without_unseen(parameters: ModelParameters, problem: PixelProblem) -> ModelParameters:
    """Features that the observations do not place are unknown, not at an accidental place."""
    placed = problem.columns.features >= 0
    enough = (problem.weights > 0).sum(axis=(0, 1)) >= 2
    parameters = parameters.copy()
    parameters.features[~(placed & enough)] = np.nan
    return parameters


def _stage(name: str, solution: Solution, problem: PixelProblem, clock: float, before: Solution | None = None) -> Stage:
    errors = problem.pixel_errors(solution.state)[problem.weights > 0]
    return Stage(
        name,
        solution.initial_cost if before is None else before.initial_cost,
        solution.cost,
        float(np.sqrt(np.mean(errors**2) / 2)),
        solution.iterations + (0 if before is None else before.iterations),
        solution.converged,
        time.perf_counter() - clock,
    )
