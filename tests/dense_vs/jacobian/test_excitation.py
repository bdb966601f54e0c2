"""Which joints a log shows, in any unit; and that what nothing moves stays at zero."""

import numpy as np
import pytest

from dense_vs import DenseJacobian, DenseVSError
from dense_vs.jacobian.excitation import excitation

UNITS = np.array([1.0, 1e-3, 1e3, 180 / np.pi, 1e4, 0.5])


def log(seed=0, frames=200):
    """Six joints: two that move, one that never does, encoder noise alone, a copy, and one that moves."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 15
    moving = [np.sin(rate * t + phase) for rate, phase in ((0.7, 0.3), (1.1, 1.0), (1.7, 2.0))]
    noise = rng.normal(0, 1e-4, (3, frames))
    first, second, third = moving + noise
    return np.stack([first, second, np.full(frames, 0.4), rng.normal(0, 1e-4, frames), -0.7 * first, third], axis=1)


NAMES = ("a", "b", "still", "noisy", "copy", "c")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
def test_names_the_joints_that_cannot_be_learned(seed, unit):
    found = excitation(log(seed) * UNITS * unit, NAMES)
    assert list(found.reasons) == ["still", "noisy", "copy"]
    assert found.reasons["still"] == "never moved"
    assert found.reasons["noisy"].startswith("hardly moved")
    assert found.reasons["copy"] == "always moved together with a"
    np.testing.assert_array_equal(found.learned, [True, True, False, False, False, True])
    steps = np.diff(log(seed), axis=0)
    expected = np.where(found.learned, np.sqrt(np.mean(steps**2, axis=0)) * UNITS * unit, 0)
    np.testing.assert_allclose(found.scale, expected, rtol=1e-12)


def learn(positions, flow_of):
    found = excitation(positions)
    estimator = DenseJacobian(
        height=24, width=32, joints=positions.shape[1], device="cpu", joint_scale=found.scale, rest=0.2
    )
    for k, dq in enumerate(np.diff(positions, axis=0)):
        estimator.update(flow_of(k), dq)
    return estimator


def test_a_log_in_other_units_scales_columns_only():
    rng = np.random.default_rng(1)
    flows = rng.normal(0, 0.5, (199, 24, 32, 2)).astype(np.float32)
    in_rad, in_units = (learn(log(2) * units, flows.__getitem__) for units in (np.ones(6), UNITS))
    J = np.array(in_rad.jacobian)
    scale = np.abs(J).max(axis=(0, 1, 2)) + 1e-9
    # float32 joint steps, rounded in another place in the other unit, 199 frames on
    np.testing.assert_allclose(in_units.jacobian * UNITS / scale, J / scale, rtol=0, atol=2e-3)


def test_what_no_joint_moves_stays_at_zero():
    """The left half moves with the first joint; the right half holds flow noise only."""
    rng = np.random.default_rng(3)
    positions = log(4)
    steps = np.diff(positions, axis=0)

    def flow_of(k):
        flow = rng.normal(0, 0.03, (24, 32, 2)).astype(np.float32)
        flow[:, :16, 0] += 40 * steps[k, 0]
        return flow

    J = learn(positions, flow_of).jacobian
    assert np.abs(J[:, 20:]).max() < 0.02 * np.abs(J[:, :12]).max()
    assert not J[..., [2, 3, 4]].any()


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (np.zeros((2, 3)), "positions has 2 rows; expected at least 3"),
        (np.full((5, 2), np.nan), "finite"),
    ],
)
def test_bad_positions(positions, message):
    with pytest.raises(DenseVSError, match=message):
        excitation(positions)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joint_scale": [1.0]}, "joint_scale"),
        ({"joint_scale": [1.0, -1.0, 1.0]}, "expected typical steps of at least 0"),
        ({"joint_scale": [1.0, 1.0, 1.0], "covariance": "full"}, "expected covariance 'shared'"),
        ({"prediction": "nearest", "covariance": "diagonal"}, "expected covariance 'shared' or 'fixed'"),
        ({"rest": 0.2, "covariance": "diagonal"}, "expected covariance 'shared' or 'fixed'"),
        ({"max_innovation": 0.0}, "max_innovation is 0.0; expected a finite number above 0"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(DenseVSError, match=message):
        DenseJacobian(height=8, width=8, joints=3, device="cpu", **options)


def test_saved_and_loaded(tmp_path):
    estimator = learn(log(5), lambda k: np.full((24, 32, 2), 0.1 * (k % 3), np.float32))
    estimator.save(tmp_path / "j.npz")
    loaded = DenseJacobian.load(tmp_path / "j.npz", device="cpu")
    np.testing.assert_array_equal(loaded.jacobian, estimator.jacobian)
    np.testing.assert_array_equal(loaded.learned, estimator.learned)
    np.testing.assert_array_equal(loaded.variance, estimator.variance)
