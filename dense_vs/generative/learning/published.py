"""Learning as the paper published it: three stages of L-BFGS over DH parameters, for comparison with the default.

Stage 1, Gothoskar (3): poses, structure and cameras from the initialization by triangulation, 200 iterations. Stage 2,
Gothoskar (5): DH parameters from a random start to the poses, sum of Frobenius distances, minibatches first, 200
iterations. Stage 3, Gothoskar (7): everything from the pixels, minibatches first, 200 iterations. With noisy joints or
actions a fourth stage frees the joints, Gothoskar (11), Gothoskar (15). Gradients are analytic where the paper
differentiates automatically; the optimizer is SciPy's L-BFGS-B. The chain has no tool transform, as printed.
"""

import time

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg, to_lines
from dense_vs.generative.learning.fitting import Fit, first_joints
from dense_vs.generative.learning.published_stages import (
    PublishedModel,
    fit_cameras_and_structure,
    fit_chain,
    fit_everything,
)
from dense_vs.generative.least_squares.outliers import robust_sigma
from dense_vs.generative.observations import Observations
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.reconstruction.initialization import guessed_intrinsics
from dense_vs.generative.reconstruction.stereo import reconstruct
from dense_vs.generative.report import FitReport
from dense_vs.kernels.arm.kinematics import FeatureProjection


def fit_as_published(obs: Observations, seed: int, state: str, state_sigma: float | None) -> Fit:
    """The three stages (four where the state is not exact)."""
    if obs.pixels.shape[1] < 2:
        raise DenseVSError("method 'paper' is offered for two or more cameras; got 1 (use method 'lm')")
    if obs.feature_link is not None:
        raise DenseVSError("method 'paper' takes features of the hand only; feature_link must be None")
    started = time.perf_counter()
    rng = np.random.default_rng(seed)
    joints = first_joints(obs, state)
    report = FitReport()
    found = next(reconstruct(obs.pixels, guessed_intrinsics(obs), rng))
    clock = time.perf_counter()
    poses, features, turns, shifts, intrinsics, stage = fit_cameras_and_structure(obs, found, clock)
    report.stages.append(stage)
    dh, stage = fit_chain(joints[found.posed], poses[found.posed], rng)
    report.stages.append(stage)
    unknowns = PublishedModel(dh.base, dh.table, features, turns, shifts, intrinsics, joints)
    unknowns, stage = fit_everything(obs, unknowns, rng)
    report.stages.append(stage)
    if state != "observed":
        sigma = 0.02 if state_sigma is None else state_sigma
        information = (0.5 / sigma) ** 2
        known = obs.joints if state == "noisy" else obs.actions
        unknowns, stage = fit_everything(obs, unknowns, rng, known, information)
        report.stages.append(stage)
        report.joint_sigma = sigma
    parameters = _as_lines(unknowns)
    problem = FeatureProjection(1, len(joints), parameters.links, joints.shape[1], len(intrinsics), 0)
    errors = _pixel_errors(problem, obs, parameters, unknowns.joints)
    report.mean_error_px = float(np.nanmean(errors))
    report.rms_px = float(np.sqrt(np.nanmean(errors**2) / 2))
    report.pixel_sigma, report.converged = robust_sigma(errors), report.stages[-1].converged
    report.seconds = time.perf_counter() - started
    return Fit(parameters, unknowns.joints, report, DenavitHartenberg(unknowns.base, unknowns.table))


def _as_lines(u: PublishedModel) -> ModelParameters:
    """The published parameters as lines and features in the home pose."""
    dh = DenavitHartenberg(u.base, u.table)
    home = u.joints.mean(axis=0)
    hand = dh.frames(home[None])[0, -1]
    features = u.features @ hand[:3, :3].T + hand[:3, 3]
    axes, points = to_lines(dh, home, np.nanmean(features, axis=0))
    links = np.full(len(features), len(axes))
    return ModelParameters(axes, points, home, features, links, u.turns, u.shifts, u.intrinsics)


def _pixel_errors(
    kernel: FeatureProjection, obs: Observations, parameters: ModelParameters, joints: np.ndarray
) -> np.ndarray:
    kernel.set(
        pixels=np.nan_to_num(obs.pixels),
        weights=obs.seen.astype(float),
        joints=joints - parameters.home,
        axes=parameters.axes,
        points=parameters.points,
        features=np.nan_to_num(parameters.features),
        camera_rotation=parameters.camera_rotation,
        camera_translation=parameters.camera_translation,
        intrinsics=parameters.intrinsics,
    )
    kernel.evaluate(jacobian=False)
    return np.where(obs.seen, np.linalg.norm(kernel.residuals[0], axis=-1), np.nan)
