"""That the estimator learns what it should: constant J, J that follows the posture, and only what is excited."""

import numpy as np
import pytest

from dense_vs import Babbling, DenseJacobian
from dense_vs.jacobian.uncertainty import motion_variance

HEIGHT, WIDTH, JOINTS = 12, 15, 4
# A noise-free constant J is found up to the prior's weight r / (p0 |dq|^2) and float32.
FOUND = 1e-3


def make(**options):
    return DenseJacobian(**{"height": HEIGHT, "width": WIDTH, "joints": JOINTS, "device": "cpu", **options})


@pytest.fixture(scope="module")
def constant():
    return np.random.default_rng(0).normal(0, 100, (HEIGHT, WIDTH, 2, JOINTS))


def learn(estimator, J, steps):
    for dq in steps:
        estimator.update((J @ dq).astype(np.float32), dq)
    return estimator


def sinusoids(frames):
    """Four joints on one frequency, a phase each."""
    t = np.arange(frames + 1)[:, None] / 30
    return np.diff(0.2 * np.sin(2 * np.pi * 0.5 * t + np.arange(JOINTS) * np.pi / 4), axis=0)


def error(estimator, J):
    return np.median(np.linalg.norm(estimator.jacobian - J, axis=(2, 3)) / np.linalg.norm(J, axis=(2, 3)))


@pytest.mark.parametrize("form", ["shared", "full", "diagonal", "fixed"])
def test_recovers_a_constant_jacobian(constant, form):
    steps = np.random.default_rng(1).normal(0, 0.05, (400, JOINTS))
    estimator = learn(make(covariance=form, order=1, prediction="none", measurement_noise=1e-4), constant, steps)
    assert error(estimator, constant) < FOUND


def test_one_frequency_on_all_joints_is_not_enough(constant):
    """Its steps span two dimensions whatever the phases, which is why there is Babbling."""
    steps = sinusoids(300)
    assert np.linalg.matrix_rank(steps, tol=1e-9) == 2
    estimator = learn(make(order=1, prediction="none", measurement_noise=1e-4), constant, steps)
    assert error(estimator, constant) > 0.3
    seen = np.linalg.svd(steps)[2][:2].T  # what it did see, it knows
    difference = (estimator.jacobian - constant) @ seen
    assert np.abs(difference).max() < FOUND * np.abs(constant).max()


def test_babbling_is_enough(constant):
    babbling = Babbling(JOINTS, seed=1)
    steps = np.array([babbling.step() for _ in range(300)])
    assert error(learn(make(order=1, prediction="none", measurement_noise=1e-4), constant, steps), constant) < FOUND


def test_second_order_follows_a_jacobian_that_changes_with_the_posture():
    rng = np.random.default_rng(2)
    H = rng.normal(0, 60, (HEIGHT, WIDTH, 2, JOINTS, JOINTS))
    H = H + np.swapaxes(H, 3, 4)
    errors = {}
    for order in (1, 2):
        babbling = Babbling(JOINTS, seed=4)
        estimator = make(order=order, prediction="none")
        J = rng.normal(0, 100, (HEIGHT, WIDTH, 2, JOINTS))
        for _ in range(400):
            dq = babbling.step()
            u = J @ dq + 0.5 * (H @ dq) @ dq
            J = J + H @ dq
            estimator.update(u.astype(np.float32), dq)
        errors[order] = error(estimator, J)
    assert errors[2] < 0.02
    assert errors[1] > 5 * errors[2]


@pytest.mark.parametrize(("order", "bound"), [(1, 0.12), (2, 0.03)])
def test_learns_a_moving_plane(scene, postures, exact_frames, order, bound):
    """The whole filter with prediction (14) on exact flow, against the exact J of a turning, growing plane."""
    estimator = make(height=scene.height, width=scene.width, order=order)
    for flow, dq in exact_frames:
        estimator.update(flow, dq)
    inner = (slice(12, -12), slice(12, -12))
    true = scene.jacobian(postures[-1])[inner]
    relative = np.linalg.norm(estimator.jacobian[inner] - true, axis=(2, 3)) / np.linalg.norm(true, axis=(2, 3))
    assert np.median(relative) < bound


@pytest.mark.parametrize(("form", "order"), [("shared", 2), ("shared", 1), ("diagonal", 1), ("full", 1)])
def test_variance_falls_where_excited_and_stays_at_its_bound_elsewhere(constant, form, order):
    estimator = make(covariance=form, order=order, process_noise=1e3, drift_noise=0.5, initial_variance=1e3,
                     max_variance=2e3)  # fmt: skip
    rng = np.random.default_rng(5)
    assert (np.array(estimator.variance) == 1e3).all()
    for _ in range(300):
        dq = rng.normal(0, 0.05, JOINTS)
        dq[2] = 0.0
        estimator.update((constant @ dq).astype(np.float32), dq)
        assert estimator.variance.max() <= 2e3 * (1 + 1e-6)
        assert estimator.variance.min() > 0
    variance = np.array(estimator.variance)
    assert (variance[..., [0, 1, 3]] < 50).all()
    if order == 1:
        np.testing.assert_allclose(variance[..., 2], 2e3, rtol=1e-5)
    else:  # what is unsure about H comes and goes with the distance from where J was best known
        assert (variance[..., 2] > 1e3).all()
    excited = variance.copy()
    for _ in range(20):  # standing still, only the drift makes it less sure
        estimator.update(np.zeros((HEIGHT, WIDTH, 2), np.float32), np.zeros(JOINTS))
    grown = np.array(estimator.variance)[..., [0, 1, 3]] - excited[..., [0, 1, 3]]
    np.testing.assert_allclose(grown, 20 * 0.5, rtol=1e-3)


def test_fixed_weight_never_changes(constant):
    estimator = make(covariance="fixed", initial_variance=7.0)
    learn(estimator, constant, sinusoids(10))
    assert (np.array(estimator.variance) == 7.0).all()
    np.testing.assert_array_equal(estimator.covariance, 7.0 * np.eye(JOINTS))


@pytest.mark.parametrize(("form", "dtype", "per_pixel"), [("shared", np.float64, False), ("full", np.float32, True),
                                                          ("diagonal", np.float32, True)])  # fmt: skip
def test_covariance_has_the_variance_on_its_diagonal(constant, form, dtype, per_pixel):
    estimator = learn(make(covariance=form, order=1), constant, sinusoids(20))
    covariance = estimator.covariance
    assert covariance.dtype == dtype
    assert covariance.shape == ((HEIGHT, WIDTH) if per_pixel else ()) + (JOINTS, JOINTS)
    expected = np.broadcast_to(np.diagonal(covariance, axis1=-2, axis2=-1), (HEIGHT, WIDTH, JOINTS))
    np.testing.assert_allclose(estimator.variance, expected, rtol=1e-6)
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, -1, -2), rtol=1e-3, atol=1e-3)
    if form == "diagonal":
        assert (covariance[..., ~np.eye(JOINTS, dtype=bool)] == 0).all()


def test_reset_forgets_everything(constant):
    fresh, used = make(), learn(make(), constant, sinusoids(20))
    used.reset()
    assert used.updates == 0
    for estimator in (fresh, used):
        learn(estimator, constant, sinusoids(3))
    np.testing.assert_array_equal(used.jacobian, fresh.jacobian)
    np.testing.assert_array_equal(used.variance, fresh.variance)


@pytest.mark.parametrize("scale", [None, (0.012, 0.024, 0.0)])
def test_what_is_not_known_of_a_motion_is_by_the_covariance_of_j(scale):
    random = np.random.default_rng(3)
    estimator = DenseJacobian(height=6, width=8, joints=3, joint_scale=scale, device="cpu", threads=1)
    for _ in range(5):
        dq = random.normal(0, 0.02, 3)
        estimator.update(random.normal(0, 1, (6, 8, 2)).astype(np.float32), dq)
    span = np.array([0.03, -0.02, 0.05])
    P, learned = estimator.covariance, estimator.learned
    expected = span[learned] @ P[np.ix_(learned, learned)] @ span[learned]
    assert motion_variance(estimator.filter, span) == pytest.approx(expected, rel=1e-6)
    assert expected > 0


@pytest.mark.parametrize("bound", [None, 1.0, 4.0])
def test_how_far_one_flow_takes_j(bound):
    """Nothing moves where J has 10 px: without a bound J follows all of that, else half a pixel times the bound."""
    estimator = make(joints=1, order=1, covariance="fixed", prediction="none", max_innovation=bound)
    for _ in range(400):
        estimator.update(np.full((HEIGHT, WIDTH, 2), 10.0, np.float32), [0.1])
    before = estimator.to_numpy().copy()
    np.testing.assert_allclose(before, 100.0, rtol=1e-3)
    estimator.update(np.zeros((HEIGHT, WIDTH, 2), np.float32), [0.1])
    change = before - estimator.to_numpy()
    gain = 0.1 / (0.1**2 + estimator.options.measurement_noise / estimator.options.initial_variance)
    off = np.sqrt(2) * 10 if bound is None else 0.5 * bound
    np.testing.assert_allclose(np.linalg.norm(change[..., 0], axis=2), gain * off, rtol=2e-3)
