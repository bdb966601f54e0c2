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


def by_definition(q):
    """Scale, span and share of its own of each joint, and why it is not learned; one joint after the other."""
    steps, learned, found = np.diff(q, axis=0), [], []
    for k in range(q.shape[1]):
        span, scale = q[:, k].max() - q[:, k].min(), np.sqrt(np.mean(steps[:, k] ** 2))
        bends = np.abs(q[2:, k] - 2 * q[1:-1, k] + q[:-2, k])
        noise, own, why = 1.4826 * np.median(bends) / np.sqrt(6), 0.0, ""
        if span <= 1e-12 * np.abs(q[:, k]).max():
            why = "never moved"
        elif span < 20 * noise:
            why = f"hardly moved: its range is {span / noise:.1f} times its noise"
        else:
            own = 1.0
            if learned:
                # Units do not matter to the share that is left of a projection, nor to the most alike joint.
                others = steps[:, learned] / np.sqrt(np.mean(steps[:, learned] ** 2, axis=0))
                basis, _ = np.linalg.qr(others)
                rest = steps[:, k] - basis @ (basis.T @ steps[:, k])
                own = (rest @ rest) / (steps[:, k] @ steps[:, k])
                if own < 1e-3:
                    alike = np.abs(others.T @ steps[:, k])
                    why = f"always moved together with {learned[int(alike.argmax())]}"
        if not why:
            learned.append(k)
        found.append((0.0 if why else scale, span, own, why))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_each_joint_is_judged_as_defined(seed):
    rng = np.random.default_rng(seed)
    t = np.arange(150) / 15
    base = np.stack([np.sin(0.7 * t), np.cos(1.3 * t), np.sin(2.9 * t + 1)], axis=1)
    columns = [base[:, 0], base[:, 1] + 0.9 * base[:, 0], 5.0 * base[:, 0] - 0.03 * base[:, 2]]
    columns += [0.3 * base[:, 1] + 0.2 * base[:, 0] + 1e-3 * base[:, 2], np.full(150, 2.0), base[:, 2]]
    columns += [size * base[:, 2] + 0.01 * rng.normal(size=150) for size in (0.05, 0.09, 0.3)]
    q = np.stack(columns, axis=1) * rng.uniform(0.1, 50.0, 9)
    found = excitation(q)
    for k, (scale, span, own, why) in enumerate(by_definition(q)):
        assert found.scale[k] == pytest.approx(scale)
        assert found.range[k] == pytest.approx(span)
        assert found.own_share[k] == pytest.approx(own, rel=1e-6, abs=1e-12)
        assert found.reasons.get(str(k), "") == why
        assert found.learned[k] == (not why)
    np.testing.assert_allclose(found.spread, np.sqrt(np.mean((q - q.mean(axis=0)) ** 2, axis=0)))
    assert len(found.reasons) >= 3


def test_three_positions_are_enough():
    assert excitation(np.array([[0.0], [1.0], [2.0]])).learned.tolist() == [True]
    with pytest.raises(DenseVSError, match="positions has 2 rows; expected at least 3"):
        excitation(np.array([[0.0], [1.0]]))
    with pytest.raises(DenseVSError, match="1 names for 2 joints"):
        excitation(np.zeros((3, 2)), ("a",))
