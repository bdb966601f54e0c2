"""Gradients of the published stages' losses against central differences, at a point away from the minimum."""

import numpy as np
import pytest

from dense_vs.generative.learning import published_stages
from dense_vs.generative.learning.published_stages import PublishedModel, fit_chain, fit_everything
from dense_vs.generative.report import Stage
from dense_vs.generative.rotations import rotation_matrices

STEP = 1e-6


@pytest.fixture
def captured(monkeypatch):
    """Losses that a stage hands to its optimizer, with the place where it would begin."""
    losses = []

    def keep(name, loss_of, x, samples, *_):
        losses.append((loss_of(np.arange(samples)), x))
        return x, Stage(name, 0.0, 0.0, 0.0, 0, False, 0.0)

    monkeypatch.setattr(published_stages, "minimize_by_minibatches", keep)
    return losses


def assert_gradient(loss, x):
    gradient = loss(x)[1]
    numeric = np.array([(loss(x + d)[0] - loss(x - d)[0]) / (2 * STEP) for d in STEP * np.eye(len(x))])
    scale = np.abs(numeric).max()
    assert scale > 0
    np.testing.assert_allclose(gradient, numeric, rtol=2e-3, atol=2e-4 * scale)


def start(ur5, joints):
    """The true chain and cameras, a little off."""
    from reference_arms import TABLES

    rng = np.random.default_rng(3)
    arm = ur5.arm
    table = TABLES["ur5"] + rng.normal(0, 0.01, (6, 4))
    return PublishedModel(
        np.eye(4),
        table,
        arm.features + rng.normal(0, 0.002, arm.features.shape),
        np.array([rotation_matrices(rng.normal(0, 0.01, 3)) @ camera.rotation for camera in arm.cameras]),
        np.array([camera.translation + rng.normal(0, 0.01, 3) for camera in arm.cameras]),
        np.hstack([ur5.intrinsics, np.zeros((2, 2))]),
        joints,
    )


@pytest.mark.parametrize("state", ["observed", "noisy", "actions"])
def test_everything(ur5, captured, state):
    obs = ur5.observations()[:4]
    rng = np.random.default_rng(1)
    known, joints = None, obs.joints
    if state != "observed":
        known = obs.joints + rng.normal(0, 0.02, obs.joints.shape)
        joints = obs.joints + rng.normal(0, 0.01, obs.joints.shape)
    if state == "actions":
        known = np.diff(known, axis=0)
    fit_everything(obs, start(ur5, joints), rng, known, 400.0)
    loss, x = captured[0]
    assert_gradient(loss, x + np.random.default_rng(2).normal(0, 0.01, len(x)))


def test_chain(captured):
    rng = np.random.default_rng(4)
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, :3] = rotation_matrices(rng.normal(size=(5, 3)))
    poses[:, :3, 3] = rng.normal(size=(5, 3))
    fit_chain(rng.normal(size=(5, 3)), poses, rng)
    loss, x = captured[0]
    assert_gradient(loss, x + rng.normal(0, 0.1, len(x)))


@pytest.mark.parametrize("actions", [False, True])
def test_the_states_own_penalty(actions):
    """By itself: beside the pixels' share its gradient would be too small to be seen."""
    rng = np.random.default_rng(5)
    joints = rng.normal(size=(4, 3))
    known = joints + rng.normal(0, 0.1, joints.shape)
    known = np.diff(known, axis=0) if actions else known
    off = (np.diff(joints, axis=0) if actions else joints) - known
    value, gradient = published_stages.state_penalty(joints, known, 400.0)
    assert value == pytest.approx(400.0 * np.sum(off**2))
    for place in np.ndindex(joints.shape):
        step = np.zeros_like(joints)
        step[place] = STEP
        there, back = (published_stages.state_penalty(joints + s, known, 400.0)[0] for s in (step, -step))
        assert gradient[place] == pytest.approx((there - back) / (2 * STEP), rel=1e-5, abs=1e-4)
