"""Steps that no robot makes are refused, and whatever is accepted leaves numbers behind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dense_vs import DenseJacobian, DenseVSError, SelfBody

HEIGHT, WIDTH, JOINTS = 8, 10, 3
FORMS = [("shared", 2), ("shared", 1), ("diagonal", 1), ("full", 1), ("fixed", 1)]


def make(covariance="shared", order=2, **options):
    size = {"height": HEIGHT, "width": WIDTH, "joints": JOINTS, "device": "cpu", "threads": 1}
    return DenseJacobian(**size, covariance=covariance, order=order, on_bad_flow="skip", **options)


def frame(rng):
    return rng.normal(0, 2, (HEIGHT, WIDTH, 2)).astype(np.float32), rng.normal(0, 0.02, JOINTS)


def is_sound(estimator):
    return np.isfinite(estimator.jacobian).all() and np.isfinite(estimator.covariance).all()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("step", [101.0, 3e3, 3e6, 3e7, 1e30])
def test_a_step_that_no_robot_makes_is_refused_and_changes_nothing(form, step):
    rng = np.random.default_rng(0)
    estimator = make(*form)
    for _ in range(5):
        estimator.update(*frame(rng))
    before = np.array(estimator.jacobian), estimator.covariance
    flow, dq = frame(rng)
    for call in (lambda: estimator.update(flow, [*dq[:2], step]), lambda: estimator.update(flow, [-step, *dq[1:]])):
        with pytest.raises(DenseVSError, match="expected steps of at most max_joint_step = 100 between two images"):
            call()
    np.testing.assert_array_equal(estimator.jacobian, before[0])
    np.testing.assert_array_equal(estimator.covariance, before[1])
    assert estimator.updates == 5
    make(*form, max_joint_step=500.0).update(flow, [*dq[:2], 400.0])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("step", [30.0, 99.0])
def test_a_large_step_every_second_leaves_numbers_for_600_frames(form, step):
    rng = np.random.default_rng(1)
    estimator = make(*form)
    for number in range(600):
        flow, dq = frame(rng)
        dq[number % JOINTS] += step if number % 30 == 7 else 0.0
        estimator.update(flow, dq)
        assert is_sound(estimator), number


@given(
    data=st.data(),
    steps=st.lists(st.lists(st.floats(-100, 100, width=32), min_size=3, max_size=3), min_size=2, max_size=20),
    form=st.sampled_from(FORMS),
)
@settings(max_examples=60, deadline=None)
def test_the_state_stays_finite(data, steps, form):
    estimator = make(*form)
    for step in steps:
        size = data.draw(st.sampled_from([0.0, 1.0, 1e4, 1e36, 3e38, np.inf, np.nan]))
        estimator.update(np.full((HEIGHT, WIDTH, 2), size, np.float32), np.array(step))
    for _ in range(10):
        estimator.update(*frame(np.random.default_rng(2)))
    assert is_sound(estimator)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", [2.0**17, 1e20, 1e36, 3e38])
def test_flow_larger_than_any_image_is_no_flow(form, size):
    rng = np.random.default_rng(3)
    wild, missing = make(*form), make(*form)
    for number in range(4):
        flow, dq = frame(rng)
        for estimator, value in ((wild, size), (missing, np.nan)):
            seen = flow.copy()
            if number == 2:
                seen[2, 3, 0], seen[5, 6, 1] = value, -value
            estimator.update(seen, dq)
        assert wild.skipped_pixels == (2 if number == 2 else 0)
    np.testing.assert_array_equal(wild.jacobian, missing.jacobian)


def test_where_the_reference_posture_lies_says_nothing_about_j():
    """A joint that turns on and on: J + H d is the same from whichever posture d is counted."""
    rng = np.random.default_rng(4)
    estimator = make()
    for _ in range(40):
        estimator.update(*frame(rng))
    before = np.array(estimator.jacobian)
    assert np.abs(estimator.filter.displacement[estimator.filter.now].numpy()).max() > 0
    estimator.filter.refer_to_present()
    np.testing.assert_allclose(estimator.jacobian, before, rtol=1e-4, atol=1e-3)
    assert (estimator.filter.displacement[estimator.filter.now].numpy() == 0).all()
    for _ in range(30):
        _, dq = frame(rng)
        estimator.predict(dq + np.array([4.0, 0.0, 0.0]))
    assert np.abs(estimator.filter.displacement[estimator.filter.now].numpy()).max() <= 54.0


@pytest.mark.parametrize("step", [3e3, 3e6, 1e30])
def test_a_body_refuses_the_same(step):
    rng = np.random.default_rng(5)
    body = SelfBody(device="cpu", synchronous=True)
    for _ in range(5):
        body.observe(*frame(rng))
    before = body.unexplained()
    flow, dq = frame(rng)
    with pytest.raises(DenseVSError, match="expected steps of at most max_joint_step = 100"):
        body.observe(flow, [*dq[:2], step])
    np.testing.assert_array_equal(body.unexplained(), before)
    for number in range(300):
        flow, dq = frame(rng)
        if number % 30 == 3:
            dq, flow[1, 1] = dq + 50.0, 1e36
        body.observe(flow, dq)
    # Energies: unexplained() is NaN where nothing is known, which is meant.
    assert np.isfinite(body._motion.energies.numpy()).all()
