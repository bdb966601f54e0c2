"""Options at their defaults and at every border, and variances in the joints' own units beside float64 references."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.jacobian import DenseJacobian, JacobianOptions
from dense_vs.jacobian.options import recorded_options, refuse_large_steps, step_factors
from dense_vs.jacobian.uncertainty import own_covariance, own_variance


def options(**changes):
    return JacobianOptions(**{"height": 8, "width": 8, "joints": 4, **changes})


def test_the_defaults_are_those_documented():
    assert asdict(options()) == {
        "height": 8, "width": 8, "joints": 4, "worlds": 1, "order": 2, "covariance": "shared", "prediction": "nearest",
        "prediction_iterations": 2, "process_noise": 300.0, "drift_noise": 0.0, "measurement_noise": 0.01,
        "initial_variance": 1e4, "hessian_noise": 1000.0, "initial_hessian_variance": 1e4, "max_variance": 1e4,
        "joint_scale": None, "rest": 0.0, "max_innovation": None, "max_joint_step": 100.0, "move_variance": False,
        "on_bad_flow": "error", "depth": False, "depth_noise": 0.006,
    }  # fmt: skip
    assert options(order=1).process_noise == 1e4
    assert options(covariance="fixed").prediction == options(covariance="full").prediction == "model"
    assert options(initial_variance=7.0).max_variance == 7.0
    assert options(initial_variance=7.0, max_variance=9.0).max_variance == 9.0


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("height", (2, 16384), (1, 16385, 2.0)),
        ("width", (2, 16384), (1, 16385, True)),
        ("joints", (1, 64), (0, 65)),
        ("worlds", (1, 65536), (0, 65537)),
        ("prediction_iterations", (1, 3), (0, 4)),
        ("order", (1, 2), (0, 3, True, 1.0)),
        ("process_noise", (0, 5.0), (-1e-9, np.inf, np.nan)),
        ("drift_noise", (0, 5.0), (-1e-9, np.inf)),
        ("hessian_noise", (0, 5.0), (-1e-9, np.inf)),
        ("measurement_noise", (1e-9,), (0.0, -1.0)),
        ("initial_variance", (1e-9,), (0.0, -1.0)),
        ("initial_hessian_variance", (1e-9,), (0.0, -1.0)),
        ("max_variance", (1e-9,), (0.0, -1.0)),
        ("rest", (0.0, 3.0), (-1e-9,)),
        ("max_innovation", (1e-9, None), (0.0,)),
        ("max_joint_step", (1e-9, 1000.0), (0.0, 1000.1)),
        ("depth_noise", (1e-9,), (0.0,)),
        ("depth", (True, False), (2, None)),
        ("move_variance", (True, False), (2, None)),
        ("on_bad_flow", ("error", "skip"), ("raise",)),
        ("covariance", ("shared", "diagonal", "fixed", "full"), ("none",)),
        ("prediction", ("model", "flow", "nearest", "none"), ("both",)),
        ("joint_scale", ((0.0, 1.0, 2.0, 3.0),), ((0.1, -0.1, 1, 1), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0, np.nan))),
    ],
)  # fmt: skip
def test_borders(name, good, bad):
    small = {"order": 1} if name == "joints" else {}
    for value in good:
        found = getattr(options(**small, **{name: value}), name)
        assert found == value
        json.dumps(found)
    for value in bad:
        with pytest.raises(DenseVSError, match=name):
            options(**small, **{name: value})


@pytest.mark.parametrize(
    ("changes", "refused"),
    [
        ({"order": 2, "joints": 8}, False),
        ({"order": 2, "joints": 9}, True),
        ({"order": 2, "covariance": "full"}, True),
        ({"covariance": "full", "joints": 8}, None),
        ({"covariance": "full", "joints": 9}, True),
        ({"prediction": "nearest", "covariance": "fixed"}, False),
        ({"prediction": "nearest", "covariance": "diagonal"}, True),
        ({"rest": 0.1, "covariance": "fixed"}, False),
        ({"rest": 0.1, "covariance": "full"}, True),
        ({"max_innovation": 2.0, "covariance": "fixed"}, False),
        ({"max_innovation": 2.0, "covariance": "diagonal"}, True),
        ({"depth": True, "prediction": "model"}, False),
        ({"depth": True, "prediction": "flow"}, True),
        ({"depth": True, "covariance": "fixed"}, True),
        ({"joint_scale": (1.0,) * 4, "covariance": "fixed"}, True),
    ],
)
def test_options_that_do_not_go_together(changes, refused):
    if refused:
        with pytest.raises(DenseVSError, match="expected"):
            options(**changes)
    elif refused is None:
        assert options(**changes).order == 1
    else:
        assert options(**changes)


@pytest.mark.parametrize(("joints", "order"), [(6, 2), (7, 1)])
def test_the_hessian_is_estimated_for_up_to_six_joints(joints, order):
    assert options(joints=joints).order == order
    assert options(joints=joints, covariance="fixed").order == 1


def test_factors_bring_typical_steps_to_a_standard_one():
    factors = step_factors((0.5, 0.0, 2.0), 3)
    assert factors[1] == 0.0
    assert factors == pytest.approx([0.024, 0.0, 0.006])  # to 0.012 rad
    one = options(joint_scale=np.array([factors[0] * 0.5, 1.0, 1.0, 1.0]))
    assert one.step_factors[0] == pytest.approx(1.0)  # the standard step itself
    assert all(type(value) is float for value in one.joint_scale)
    assert step_factors(None, 2) == (1.0, 1.0)


def learned(**changes):
    estimator = DenseJacobian(height=6, width=7, joints=3, device="cpu", threads=1, **changes)
    rng = np.random.default_rng(0)
    for k in range(5):
        dq = 0.02 * rng.normal(size=3)
        estimator.update(np.full((6, 7, 2), 0.3 * k, np.float32), dq)
    return estimator


@pytest.mark.parametrize("order", [1, 2])
def test_variances_are_in_the_joints_own_units(order):
    """A joint in other units, of the same motion: its column is as many times smaller as its numbers are larger."""
    scale = (0.02, 0.05, 0.01)
    found = learned(order=order, joint_scale=scale)
    rows = found.filter
    stored = np.asarray(rows.stored_covariance(), np.float64)[0, :3, :3]
    factors = np.array(step_factors(scale, 3))
    expected = np.diag(factors) @ stored @ np.diag(factors)
    assert np.abs(expected - np.diag(np.diagonal(expected))).max() > 0
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-12)
    np.testing.assert_allclose(found.variance, np.broadcast_to(np.diagonal(expected), (6, 7, 3)), rtol=1e-6)
    plain = learned(order=order)
    np.testing.assert_allclose(plain.covariance, np.asarray(plain.filter.stored_covariance())[0, :3, :3])
    before = plain.covariance.copy()
    plain.covariance[:] = -1.0  # a copy
    np.testing.assert_array_equal(plain.covariance, before)


def test_of_a_joint_that_is_not_learned_nothing_is_known():
    found = learned(order=1, joint_scale=(0.02, 0.0, 0.01))
    assert found.learned.tolist() == [True, False, True]
    assert np.isinf(found.variance[..., 1]).all()
    assert np.isfinite(found.variance[..., [0, 2]]).all()
    covariance = found.covariance
    assert covariance[1].tolist() == [0.0, np.inf, 0.0]
    assert covariance[:, 1].tolist() == [0.0, np.inf, 0.0]
    both = learned(order=1, joint_scale=(0.02, 0.0, 0.01)).filter
    assert own_covariance(both).shape == (1, 3, 3)
    assert own_variance(both).shape == (1, 6, 7, 3)
    assert np.isfinite(covariance[np.ix_([0, 2], [0, 2])]).all()
    assert abs(covariance[0, 2]) > 0


@pytest.mark.parametrize("form", ["diagonal", "full"])
def test_each_pixel_s_own_covariance(form):
    found = learned(covariance=form)
    stored = np.asarray(found.filter.stored_covariance())[0]
    whole = stored if form == "full" else stored[..., None] * np.eye(3)
    np.testing.assert_allclose(found.covariance, whole, rtol=1e-6)
    np.testing.assert_allclose(found.variance, np.diagonal(whole, axis1=-2, axis2=-1), rtol=1e-6)


def test_steps_beyond_the_largest_are_refused():
    factors = np.array([2.0, 0.0, 1.0])
    refuse_large_steps(np.array([5.0, 1e9, -10.0]), "dq", factors, 10.0)
    for step in ([5.01, 0.0, 0.0], [0.0, 0.0, -10.1]):
        with pytest.raises(DenseVSError, match="dq"):
            refuse_large_steps(np.array(step), "dq", factors, 10.0)


def test_options_for_recordings_of_seven_joints_and_more():
    assert recorded_options(6) == {}
    chosen = recorded_options(7)
    assert chosen == {
        "measurement_noise": 0.3, "initial_variance": 2800.0, "process_noise": 2.3e5, "rest": 0.2,
        "max_innovation": 1.0,
    }  # fmt: skip
    assert options(joints=7, **chosen).order == 1


def test_a_depth_noise_whose_variance_would_not_be_finite_is_refused():
    assert options(depth=True, depth_noise=1e6).depth_noise == 1e6
    with pytest.raises(DenseVSError, match="depth_noise is 1000001"):
        options(depth=True, depth_noise=1000001.0)
