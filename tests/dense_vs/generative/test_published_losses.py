"""The published stages' losses as the paper writes them, their gradients by differences, and where each begins."""

from types import SimpleNamespace

import numpy as np
import pytest
from exact_arm import SIZES, exact_arm
from scipy.spatial.transform import Rotation

from dense_vs.generative import Observations
from dense_vs.generative.kinematics.denavit_hartenberg import DenavitHartenberg
from dense_vs.generative.learning import published_stages
from dense_vs.generative.learning.published_stages import (
    PublishedModel,
    fit_cameras_and_structure,
    fit_chain,
    fit_everything,
    pose_loss,
)
from dense_vs.generative.report import Stage

STEP = 1e-6
SAMPLES = 5


def turns(rng, count, size):
    return Rotation.from_rotvec(size * rng.normal(size=(count, 3))).as_matrix()


def shown(rotation, translation, features, view, shift, lenses):
    """Pixels of a hand's features in given poses."""
    world = np.einsum("tij,mj->tmi", rotation, features) + translation[:, None]
    seen = np.einsum("cij,tmj->tcmi", view, world) + shift[:, None]
    return seen[..., :2] / seen[..., 2:] * lenses[:, None, :2] + lenses[:, None, 2:4]


@pytest.fixture
def hand():
    """A reconstruction of a hand, and pixels that are a little off; some were not seen, some poses are not known."""
    rng, arm = np.random.default_rng(0), exact_arm(samples=SAMPLES)
    p = arm.parameters
    found = SimpleNamespace(
        rotation=turns(rng, SAMPLES, 0.4), translation=0.1 * rng.normal(size=(SAMPLES, 3)),
        structure=0.2 * rng.normal(size=(10, 3)), camera_rotation=p.camera_rotation,
        camera_translation=p.camera_translation, posed=np.arange(SAMPLES) != 3, placed_cameras=np.ones(2, bool),
    )  # fmt: skip
    pixels = shown(found.rotation, found.translation, found.structure, p.camera_rotation, p.camera_translation,
                   p.intrinsics)  # fmt: skip
    pixels += 3.0 * rng.normal(size=pixels.shape)
    pixels[1, 0, 4] = np.nan
    found.structure[7] = np.nan
    return found, Observations(pixels=pixels, image_sizes=SIZES, intrinsics=p.intrinsics[:, :4])


@pytest.fixture
def captured(monkeypatch):
    losses = []

    def keep(name, loss, x, iterations, clock, residuals):
        losses.append((name, loss, x, iterations, residuals))
        return x, Stage(name, 0.0, 0.0, 0.0, 0, False, 0.0)

    def keep_batches(name, loss_of, x, samples, rng, clock, residuals):
        losses.append((name, loss_of, x, samples, residuals))
        return x, Stage(name, 0.0, 0.0, 0.0, 0, False, 0.0)

    monkeypatch.setattr(published_stages, "minimize_loss", keep)
    monkeypatch.setattr(published_stages, "minimize_by_minibatches", keep_batches)
    return losses


def assert_gradient(loss, x):
    gradient = loss(x)[1]
    numeric = np.array([(loss(x + d)[0] - loss(x - d)[0]) / (2 * STEP) for d in STEP * np.eye(len(x))])
    np.testing.assert_allclose(gradient, numeric, rtol=2e-3, atol=1e-5 * np.abs(numeric).max())


def test_cameras_and_structure(hand, captured):
    found, obs = hand
    poses, shape, view, shift, lenses, _ = fit_cameras_and_structure(obs, found, 0.0)
    ((name, loss, x, iterations, residuals),) = captured
    assert (name, iterations, len(x)) == ("cameras and structure", published_stages.ITERATIONS, 30 + 30 + 12 + 8)
    assert not x.any()
    used = np.isfinite(obs.pixels[..., 0]) & found.posed[:, None, None] & np.isfinite(found.structure[:, 0])
    assert residuals == 2 * used.sum()
    # The start is the reconstruction.
    np.testing.assert_allclose(poses[:, :3, :3], found.rotation)
    np.testing.assert_allclose(poses[:, :3, 3], found.translation)
    np.testing.assert_array_equal(poses[:, 3], np.tile([0, 0, 0, 1], (SAMPLES, 1)))
    np.testing.assert_allclose(shape, np.nan_to_num(found.structure))
    np.testing.assert_allclose(view, found.camera_rotation)
    np.testing.assert_allclose(shift, found.camera_translation)
    np.testing.assert_allclose(lenses, np.hstack([obs.intrinsics[:, :4], np.zeros((2, 2))]))

    def squares(x):
        pose, shape, camera, inner = np.split(x, [30, 60, 72])
        pose, camera = pose.reshape(-1, 6), camera.reshape(-1, 6)
        made = shown(
            Rotation.from_rotvec(pose[:, :3]).as_matrix() @ found.rotation, found.translation + pose[:, 3:],
            np.nan_to_num(found.structure) + 0.1 * shape.reshape(-1, 3),
            Rotation.from_rotvec(camera[:, :3]).as_matrix() @ found.camera_rotation,
            found.camera_translation + camera[:, 3:], obs.intrinsics[:, :4] + 100 * inner.reshape(-1, 4),
        )  # fmt: skip
        return np.sum((made - obs.pixels)[used] ** 2)

    for place in (x, 0.05 * np.random.default_rng(1).normal(size=80)):
        assert loss(place)[0] == pytest.approx(squares(place), rel=1e-9)
        assert_gradient(loss, place)
    behind = x.copy()
    behind[5] = -9.0
    assert loss(behind)[0] == 1e12
    assert np.isfinite(loss(behind)[1]).all()


def chained(base, table, joints):
    """Denavit and Hartenberg's four steps, a joint after the other."""
    found = []
    for q in joints:
        T = base.copy()
        for (theta, d, a, alpha), angle in zip(table, q, strict=True):
            turn, twist = np.eye(4), np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec([0, 0, theta + angle]).as_matrix()
            twist[:3, :3] = Rotation.from_rotvec([alpha, 0, 0]).as_matrix()
            along = np.eye(4)
            along[2, 3], twist[0, 3] = d, a
            T = T @ turn @ along @ twist
        found.append(T)
    return np.array(found)


def base_of(rng):
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = turns(rng, 1, 0.5)[0], 0.3 * rng.normal(size=3)
    return base


def test_the_distance_of_poses():
    rng = np.random.default_rng(2)
    base, table, joints = base_of(rng), 0.4 * rng.normal(size=(3, 4)), rng.normal(size=(SAMPLES, 3))
    poses = chained(base_of(rng), table, joints + 0.1)
    value, _ = pose_loss(DenavitHartenberg(base, table), joints, poses)
    expected = sum(np.linalg.norm(one - pose) for one, pose in zip(chained(base, table, joints), poses, strict=True))
    assert value == pytest.approx(expected)


def test_where_a_chain_begins(captured):
    rng = np.random.default_rng(3)
    poses = chained(base_of(rng), 0.3 * rng.normal(size=(3, 4)), rng.normal(size=(SAMPLES, 3)))
    joints = rng.normal(size=(SAMPLES, 3))
    starts = [fit_chain(joints, poses, np.random.default_rng(seed))[0] for seed in range(200)]
    name, loss_of, x, samples, residuals = captured[0]
    assert (name, len(x), samples, residuals) == ("kinematics", 18, SAMPLES, 12 * SAMPLES)
    assert not x.any()
    tables = np.array([one.table for one in starts])
    for column, (low, high) in enumerate(((-np.pi, np.pi), (0, 0.3), (0, 0.3), (-np.pi, np.pi))):
        assert low <= tables[..., column].min() < low + 0.05 * (high - low)
        assert high >= tables[..., column].max() > high - 0.05 * (high - low)
    places = np.array([one.base[:3, 3] for one in starts]) - poses[:, :3, 3].mean(axis=0)
    np.testing.assert_allclose(places.std(axis=0), 0.3, rtol=0.2)
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=0.08)
    sizes = Rotation.from_matrix([one.base[:3, :3] for one in starts]).magnitude()
    assert sizes.std() > 0.3
    # A step moves it: a turn of the base, its place, the table; a batch is a part of the samples.
    begun = starts[0]
    x = 0.2 * np.random.default_rng(5).normal(size=18)
    base = begun.base.copy()
    base[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix() @ base[:3, :3]
    base[:3, 3] += x[3:6]
    batch = np.array([0, 3])
    expected, _ = pose_loss(DenavitHartenberg(base, begun.table + x[6:].reshape(3, 4)), joints[batch], poses[batch])
    assert loss_of(batch)(x)[0] == pytest.approx(expected)
    assert_gradient(loss_of(batch), x)


@pytest.mark.parametrize("state", ["observed", "noisy", "actions"])
def test_everything(captured, state):
    rng, arm = np.random.default_rng(6), exact_arm(samples=SAMPLES)
    p = arm.parameters
    base, table = base_of(rng), 0.2 * rng.normal(size=(3, 4))
    joints = rng.normal(size=(SAMPLES, 3))
    features = 0.15 * rng.normal(size=(10, 3))
    frames = chained(base, table, joints)
    pixels = shown(frames[:, :3, :3], frames[:, :3, 3], features, p.camera_rotation, p.camera_translation, p.intrinsics)
    pixels += rng.normal(size=pixels.shape)
    pixels[2, 1, 3] = np.nan
    obs = Observations(joints=joints, pixels=pixels, image_sizes=SIZES)
    begun = PublishedModel(base, table, features, p.camera_rotation, p.camera_translation, p.intrinsics, joints)
    known = {"observed": None, "noisy": joints + 0.1, "actions": np.diff(joints, axis=0) - 0.1}[state]
    found, _ = fit_everything(obs, begun, rng, known, 40.0)
    name, loss_of, x, samples, residuals = captured[0]
    used = np.isfinite(pixels[..., 0])
    assert (name, samples) == ("end to end" if state == "observed" else "noise of the state", SAMPLES)
    assert residuals == 2 * used.sum()
    assert len(x) == 6 + 12 + 30 + 12 + 8 + (0 if state == "observed" else 15)
    np.testing.assert_allclose(found.table, table)
    np.testing.assert_allclose(found.joints, joints)
    step = 0.03 * np.random.default_rng(7).normal(size=len(x))
    step[60:68] *= 0.1
    captured[0:] = []
    mask = np.array([True, False, True, True, False])
    b, t, f, c, k, q = np.split(step, [6, 18, 48, 60, 68])
    moved = base.copy()
    moved[:3, :3] = Rotation.from_rotvec(b[:3]).as_matrix() @ base[:3, :3]
    moved[:3, 3] += b[3:]
    now = joints + 0.1 * q.reshape(-1, 3) if len(q) else joints
    frames = chained(moved, table + t.reshape(3, 4), now)
    c = c.reshape(2, 6)
    made = shown(frames[:, :3, :3], frames[:, :3, 3], features + 0.1 * f.reshape(10, 3),
                 Rotation.from_rotvec(c[:, :3]).as_matrix() @ p.camera_rotation, p.camera_translation + c[:, 3:],
                 p.intrinsics[:, :4] + 100 * k.reshape(2, 4))  # fmt: skip
    expected = np.sum((made - pixels)[used & mask[:, None, None]] ** 2)
    if known is not None:
        expected += 40.0 * np.sum(((now if state == "noisy" else np.diff(now, axis=0)) - known) ** 2)
    loss = loss_of(np.flatnonzero(mask))
    assert loss(step)[0] == pytest.approx(expected, rel=1e-9)
    assert_gradient(loss, step)
    behind = np.zeros(len(step))
    behind[5] = -30.0
    assert loss(behind)[0] == 1e12
