"""The Cramer-Rao bound: the least error of any unbiased estimator that learns from the very samples of a run.

At the true parameters the inverse of the Fisher information, of all that a fit leaves open and with what it is told of
the lenses, is the least covariance of what it learns. Errors drawn from it give the pixel errors that a perfect fit
would have on other postures, beside which those of a real one can be put. It needs the truth, so it is for scoring.
"""

from dataclasses import dataclass, replace

import numpy as np

from dense_vs.checks import check_choice
from dense_vs.errors import DenseVSError
from dense_vs.generative.learning.end_to_end import all_shared
from dense_vs.generative.learning.expected_error import inverse_root
from dense_vs.generative.least_squares.joint_priors import JointActions, JointReadings
from dense_vs.generative.least_squares.pixel_problem import Free, NormalEquations, PixelProblem, PixelState
from dense_vs.generative.parameters import ModelParameters
from dense_vs.generative.prediction import predict
from dense_vs.generative.reconstruction.initialization import intrinsics_prior
from dense_vs.sims.marked_arm.evidence import PIXEL_NOISE, Evidence
from dense_vs.sims.marked_arm.observed_arm import ObservedArm

_DRAWS = 100


@dataclass(frozen=True)
class Bound:
    """Mean pixel errors (draws,) [px] on test postures, each of a model that errs by a draw from the least covariance.

    ``noisy`` are against pixels with measurement noise, ``exact`` against pixels without.
    """

    noisy: np.ndarray
    exact: np.ndarray


def cramer_rao(
    learned_from: Evidence,
    test: Evidence,
    rng: np.random.Generator,
    *,
    state: str = "observed",
    sigma: float = 0.0,
    camera: int | None = None,
    draws: int = _DRAWS,
) -> Bound:
    """The errors of a perfect fit to these samples.

    Args:
        learned_from, test: samples with their truth, of the same arm; pixel noise as :func:`observe` adds it.
        rng: draws the errors.
        state: ``"observed"``, ``"noisy"`` or ``"actions"``, as the fit's.
        sigma: noise of the joint readings, or of each joint step [rad].
        camera: whose pose alone is to be learned, all else being known; None where all is to be learned.
        draws: how many.

    Raises:
        DenseVSError: no joints are behind the samples, or noisy states without a sigma.
    """
    truth = learned_from.truth
    if truth.joints is None or test.truth.joints is None:
        raise DenseVSError("the samples are of a Cartesian controller; the bound is computed for joints")
    check_choice("state", state, ("observed", "noisy", "actions"))
    if (state == "observed") != (sigma == 0.0):
        raise DenseVSError(f"state is {state!r} with sigma {sigma} rad; expected 0 for 'observed' and more for others")
    parameters = true_parameters(truth.arm, truth.joints.mean(axis=0))
    observations = learned_from.observations
    known = observations.seen.any(axis=(0, 1))
    cameras = np.arange(len(truth.arm.cameras))
    free = replace(all_shared(np.ones(len(cameras), dtype=bool)), features=known)
    if camera is not None:
        known, free = np.ones_like(known), Free(cameras=cameras == camera)
    prior = None
    if state == "noisy":
        prior = JointReadings(truth.joints, (PIXEL_NOISE / sigma) ** 2)
    elif state == "actions":
        prior = JointActions(np.diff(truth.joints, axis=0), (PIXEL_NOISE / sigma) ** 2)
    problem = PixelProblem(
        truth.pixels,
        parameters.links,
        truth.joints.shape[1],
        free,
        "none" if prior is None else "joints",
        prior,
        intrinsics_prior(observations, parameters.intrinsics, PIXEL_NOISE),
    )
    start = PixelState(parameters, truth.joints)
    root = PIXEL_NOISE * inverse_root(_information(problem.linearize(start)))
    exact = test.truth.pixels
    seen = np.isfinite(exact[..., 0]) & known
    measured = exact + rng.normal(0.0, PIXEL_NOISE, exact.shape)
    errors = np.zeros((2, draws))
    for draw in range(draws):
        wrong = root @ rng.normal(size=root.shape[1])
        shared, own = wrong[: problem.count], wrong[problem.count :].reshape(-1, truth.joints.shape[1])
        # Actions leave an offset of each joint open; who scores takes out the mean over the samples, and so does this.
        offset = own.mean(axis=0) if state == "actions" else 0.0
        generated = predict(
            problem.move(start, shared, own if len(own) else None).parameters, test.truth.joints + offset
        )
        for row, pixels in enumerate((measured, exact)):
            errors[row, draw] = np.linalg.norm(generated - pixels, axis=-1)[seen].mean()
    return Bound(*errors)


def perfect_inference(test: Evidence, cameras: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (T,) that the joints of single images have with a perfect model and an estimator that reaches the bound.

    That is the least-squares estimate linearized at the truth, with the images' own noise.

    Args:
        test: images with their truth.
        cameras: (c,) whose images are looked at.

    Returns:
        The norm of the joints' error [rad], which of more than 6 joints leaves out the motion that no image shows; and
        the mean distance [px] between the pixels at those joints and the measured ones, over all cameras.

    Raises:
        DenseVSError: no joints are behind the images.
    """
    truth = test.truth
    if truth.joints is None:
        raise DenseVSError("the images are of a Cartesian controller; the bound is computed for joints")
    parameters = true_parameters(truth.arm, truth.joints.mean(axis=0))
    measured = test.observations.pixels
    pixels = np.where(cameras[:, None, None], measured, np.nan)
    problem = PixelProblem(pixels, parameters.links, truth.joints.shape[1], Free(), "joints")
    equations = problem.linearize(PixelState(parameters, truth.joints))
    assert equations.local is not None
    assert equations.local_gradient is not None
    roots = [inverse_root(own) for own in equations.local]
    off = -np.array([root @ root.T @ pull for root, pull in zip(roots, equations.local_gradient, strict=True)])
    distance = np.linalg.norm(predict(parameters, truth.joints + off) - measured, axis=-1)
    return np.linalg.norm(off, axis=1), np.nanmean(distance, axis=(1, 2))


def true_parameters(arm: ObservedArm, home: np.ndarray) -> ModelParameters:
    """Parameters of a perfect model, in the robot's frame and in meters, with the home pose ``home`` [rad]."""
    poses = arm.chain.link_poses(home)
    before = np.concatenate([np.eye(4)[None], poses[:-1]])
    axes, origins = before[:, :3, 2], before[:, :3, 3]
    features = arm.features @ poses[-1, :3, :3].T + poses[-1, :3, 3]
    near = features.mean(axis=0)
    return ModelParameters(
        axes,
        origins + axes * ((near - origins) * axes).sum(axis=1, keepdims=True),
        home,
        features,
        np.full(len(features), len(axes)),
        np.array([camera.T_camera_world[:3, :3] for camera in arm.cameras]),
        np.array([camera.T_camera_world[:3, 3] for camera in arm.cameras]),
        np.array([[*camera.intrinsics, 0.0, 0.0] for camera in arm.cameras]),
    )


def _information(equations: NormalEquations) -> np.ndarray:
    """The normal matrix of shared unknowns and those of every sample in one."""
    if equations.local is None:
        return equations.shared
    assert equations.coupling is not None
    shared, (samples, own, _) = len(equations.shared), equations.local.shape
    matrix = np.zeros((shared + samples * own,) * 2)
    matrix[:shared, :shared] = equations.shared
    for t in range(samples):
        at = slice(shared + t * own, shared + (t + 1) * own)
        matrix[at, at], matrix[at, :shared] = equations.local[t], equations.coupling[t]
        matrix[:shared, at] = equations.coupling[t].T
        if equations.chained is not None and t + 1 < samples:
            following = slice(at.stop, at.stop + own)
            matrix[following, at], matrix[at, following] = equations.chained[t], equations.chained[t].T
    return matrix
