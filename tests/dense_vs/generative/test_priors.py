"""What readings and actions add to the loss: gradients and blocks against central differences of the cost."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.learning.published_stages import state_penalty
from dense_vs.generative.least_squares.joint_priors import JointActions, JointReadings
from dense_vs.generative.least_squares.pixel_problem import NormalEquations, PixelState
from dense_vs.generative.least_squares.pose_priors import PoseActions, PoseReadings
from dense_vs.generative.parameters import ModelParameters

SAMPLES, STEP = 4, 1e-5


def no_parameters():
    nothing = np.zeros((0, 3))
    return ModelParameters(nothing, nothing, np.zeros(0), nothing, np.zeros(0, int), nothing, nothing, nothing)


def random_poses(rng, count, angle=0.8):
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, angle, (count, 3))).as_matrix()
    poses[:, :3, 3] = rng.normal(0, 1.0, (count, 3))
    return poses


def joint_case(kind):
    rng = np.random.default_rng(0)
    joints = rng.normal(size=(SAMPLES, 3))
    if kind == "readings":
        prior = JointReadings(joints + rng.normal(0, 0.1, joints.shape), 7.0)
    else:
        prior = JointActions(np.diff(joints, axis=0) + rng.normal(0, 0.1, (SAMPLES - 1, 3)), 7.0)

    def at(step):
        return PixelState(no_parameters(), joints + step)

    return prior, at, 3


def pose_case(kind):
    """Readings or actions that the poses nearly follow: only there is the gradient's first order exact."""
    rng = np.random.default_rng(1)
    poses = random_poses(rng, SAMPLES)
    if kind == "readings":
        prior = PoseReadings(random_poses(rng, SAMPLES, 1e-3) @ poses, (5.0, 3.0))
        prior.poses[:, :3, 3] = poses[:, :3, 3] + rng.normal(0, 0.01, (SAMPLES, 3))
    else:
        actions = poses[1:] @ np.linalg.inv(poses[:-1])
        actions[:, :3, :3] = (
            Rotation.from_rotvec(rng.normal(0, 1e-3, (SAMPLES - 1, 3))).as_matrix() @ actions[:, :3, :3]
        )
        actions[:, :3, 3] += rng.normal(0, 0.01, (SAMPLES - 1, 3))
        prior = PoseActions(actions, (5.0, 3.0))

    def at(step):
        turned = Rotation.from_rotvec(step[:, :3]).as_matrix() @ poses[:, :3, :3]
        return PixelState(no_parameters(), np.zeros((SAMPLES, 0)), turned, poses[:, :3, 3] + step[:, 3:])

    return prior, at, 6


@pytest.mark.parametrize("kind", ["readings", "actions"])
@pytest.mark.parametrize("case", [joint_case, pose_case])
def test_gradient_and_blocks(case, kind):
    prior, at, width = case(kind)
    equations = NormalEquations(0.0, np.zeros((0, 0)), np.zeros(0))
    equations.local, equations.local_gradient = np.zeros((SAMPLES, width, width)), np.zeros((SAMPLES, width))
    still = np.zeros((SAMPLES, width))
    prior.add(at(still), equations)
    for sample, unknown in np.ndindex(SAMPLES, width):
        step = still.copy()
        step[sample, unknown] = STEP
        slope = (prior.cost(at(step)) - prior.cost(at(-step))) / (2 * STEP)
        np.testing.assert_allclose(2 * equations.local_gradient[sample, unknown], slope, atol=2e-3, rtol=1e-3)
        curvature = (prior.cost(at(step)) - 2 * prior.cost(at(still)) + prior.cost(at(-step))) / STEP**2
        np.testing.assert_allclose(2 * equations.local[sample, unknown, unknown], curvature, rtol=0.05, atol=0.1)
    if kind == "actions":
        for sample in range(SAMPLES - 1):
            for row, column in np.ndindex(width, width):
                mixed = 0.0
                for first, second in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                    step = still.copy()
                    step[sample + 1, row], step[sample, column] = first * 1e-3, second * 1e-3
                    mixed += first * second * prior.cost(at(step)) / 4e-6
                np.testing.assert_allclose(2 * equations.chained[sample, row, column], mixed, rtol=0.05, atol=0.1)


@pytest.mark.parametrize("kind", ["readings", "actions"])
def test_penalty_of_the_published_fourth_stage(kind):
    rng = np.random.default_rng(2)
    joints = rng.normal(size=(SAMPLES, 3))
    known = rng.normal(size=(SAMPLES if kind == "readings" else SAMPLES - 1, 3))
    value, gradient = state_penalty(joints, known, 7.0)
    off = joints - known if kind == "readings" else joints[1:] - joints[:-1] - known
    np.testing.assert_allclose(value, 7.0 * (off**2).sum())
    for place in np.ndindex(joints.shape):
        step = np.zeros_like(joints)
        step[place] = STEP
        ahead, behind = (state_penalty(joints + sign * step, known, 7.0)[0] for sign in (1, -1))
        np.testing.assert_allclose(gradient[place], (ahead - behind) / (2 * STEP), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kind", ["readings", "actions"])
def test_spread_of_the_deviations_is_that_of_the_poses_carried_over(kind):
    """J S J' with central differences and the whole covariance S of all samples' turns and shifts."""
    prior, at, width = pose_case(kind)
    rng = np.random.default_rng(4)
    root = rng.normal(size=(SAMPLES * width, SAMPLES * width))
    covariance = root @ root.T
    blocks = covariance.reshape(SAMPLES, width, SAMPLES, width)
    own = np.stack([blocks[t, :, t] for t in range(SAMPLES)])
    across = np.stack([blocks[t + 1, :, t] for t in range(SAMPLES - 1)])
    steps = STEP * np.eye(SAMPLES * width).reshape(-1, SAMPLES, width)
    J = np.stack([(prior.deviations(at(s)) - prior.deviations(at(-s))).ravel() / (2 * STEP) for s in steps], axis=1)
    expected = np.einsum("ij,jk,ik->i", J, covariance, J).reshape(-1, 6)
    np.testing.assert_allclose(prior.spread(at(np.zeros((SAMPLES, width))), own, across), expected, rtol=5e-3)
