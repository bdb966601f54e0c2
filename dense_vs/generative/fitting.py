"""Learning in stages: reconstruction, kinematics, and all parameters from the pixels."""

import time

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.bundle_adjustment import adjust_bundle
from dense_vs.generative.end_to_end import all_shared, coordinate_rms, fit_kinematics, fit_pixels, initial_parameters
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.pixel_problem import PixelProblem
from dense_vs.generative.report import FitReport, Stage
from dense_vs.generative.stereo import reconstruct


def guessed_intrinsics(obs: Observations) -> np.ndarray:
    """The given intrinsics ``(c, 6)``, or a usual lens for each image size."""
    if obs.intrinsics is not None:
        return obs.intrinsics.copy()
    rows = [[1.1 * max(h, w), 1.1 * max(h, w), (w - 1) / 2, (h - 1) / 2, 0, 0] for h, w in obs.image_sizes]
    return np.array(rows)


def fit_observed(obs: Observations, seed: int) -> tuple[ModelParameters, np.ndarray, FitReport]:
    """Parameters, joints ``(T, n)`` and report from joints that are read exactly."""
    started = time.perf_counter()
    if obs.joints is None:
        raise DenseVSError("state 'observed' needs joints; got None")
    rng = np.random.default_rng(seed)
    report = FitReport()
    links = np.full(obs.pixels.shape[2], obs.joints.shape[1])
    intrinsics = guessed_intrinsics(obs)
    clock = time.perf_counter()
    found = reconstruct(obs.pixels, intrinsics)
    found, intrinsics, solution, _ = adjust_bundle(obs.pixels, intrinsics, found)
    seen = obs.seen.sum()
    report.stages.append(_stage("cameras and structure", solution, np.sqrt(solution.cost / (2 * seen)), clock))
    centre = obs.joints.mean(axis=0)
    chains, stage = fit_kinematics(obs.joints - centre, found, rng)
    report.stages.append(stage)
    clock = time.perf_counter()
    problem = PixelProblem(obs.pixels, links, obs.joints.shape[1], all_shared(found.placed_cameras))
    starts = [initial_parameters(chain, found, centre, intrinsics) for chain in chains]
    solution, _ = fit_pixels(problem, obs.joints, starts)
    report.stages.append(_stage("end to end", solution, coordinate_rms(problem, solution.cost), clock))
    report.rms_px = report.stages[-1].rms
    report.mean_error_px = float(np.nanmean(problem.pixel_errors(solution.state)))
    report.converged = solution.converged
    report.pixel_sigma = report.rms_px
    report.seconds = time.perf_counter() - started
    return solution.state.parameters, obs.joints, report


def _stage(name, solution, rms, clock) -> Stage:
    return Stage(
        name,
        solution.initial_cost,
        solution.cost,
        float(rms),
        solution.iterations,
        solution.converged,
        time.perf_counter() - clock,
    )
