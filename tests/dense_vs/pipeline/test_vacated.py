"""J stays behind where a body has left, and is drawn to 0 where nothing moves there; bodies and flows by hand."""

import numpy as np
import pytest

from dense_vs.jacobian import DenseJacobian
from dense_vs.pipeline import BodyPrior
from dense_vs.pipeline.vacated import BESIDE, LATELY, MOVING, STILL, Vacated

SIZE = (64, 80)
J = np.array([[40.0], [-20.0]], np.float32)  # px/rad
STEP = np.array([0.05], np.float32)
EXPECTED = np.tile(J[:, 0] * STEP, (*SIZE, 1))
STANDS = np.zeros((*SIZE, 2), np.float32)


def body(left):
    mask = np.zeros(SIZE, bool)
    mask[10:50, left : left + 30] = True
    return mask


def left_behind(flow=STANDS, expected=EXPECTED, since=1):
    vacated = Vacated(SIZE)
    assert not vacated.observe(body(5), STANDS, EXPECTED).any()
    for _ in range(since - 1):
        vacated.observe(body(45), EXPECTED, EXPECTED)
    return vacated.observe(body(45), flow, expected)


def test_what_the_body_has_left_and_nothing_else_is_found():
    truth = np.zeros(SIZE, bool)
    truth[10:50, 5:35] = True  # the body is farther away than its outline may be off
    np.testing.assert_array_equal(left_behind(), truth)


def test_around_the_body_nothing_is_found_as_its_outline_may_be_off():
    vacated = Vacated(SIZE)
    vacated.observe(body(20), STANDS, EXPECTED)
    found = vacated.observe(body(20 + BESIDE + 3), STANDS, EXPECTED)
    assert found[30, 20:23].all()
    assert not found[:, 23:].any()


@pytest.mark.parametrize(
    ("flow", "found"),
    [
        (EXPECTED, False),
        (0.9 * STILL * EXPECTED, True),
        (1.1 * STILL * EXPECTED, False),
        (np.full_like(STANDS, np.nan), False),
    ],
)
def test_what_moves_or_is_not_seen_keeps_its_j(flow, found):
    assert left_behind(flow).any() == found


@pytest.mark.parametrize("size", [0.9, 1.1])
def test_a_motion_that_is_too_small_by_j_says_nothing(size):
    expected = EXPECTED * size * MOVING / np.linalg.norm(EXPECTED[0, 0])
    assert left_behind(expected=expected).any() == (size > 1)


def test_what_was_left_long_ago_may_be_something_else():
    assert left_behind(since=LATELY).any()
    assert not left_behind(since=LATELY + 1).any()


def estimator_with(J):
    estimator = DenseJacobian(height=SIZE[0], width=SIZE[1], joints=1, device="cpu", threads=1, on_bad_flow="skip")
    estimator.blend(np.tile(J, (*SIZE, 1, 1)), np.ones(SIZE, np.float32))
    return estimator


def prior_of_a_moving_body():
    def known(q):
        mask = body(5 if q[0] < 0 else 45)
        return np.where(mask[..., None, None], J, np.float32(0)), mask

    return BodyPrior(known, share=0.8)


def test_a_motion_that_is_sound_draws_j_to_0_where_the_body_was():
    prior, estimator = prior_of_a_moving_body(), estimator_with(J)
    for q in ([-1.0], [1.0]):
        seen = np.where(prior.known(q)[1][..., None], EXPECTED, STANDS)
        assert prior.uncovered(estimator, np.array(q), seen, STEP) is seen
        prior.correct(estimator, np.array(q), seen, STEP)
    after = estimator.to_numpy()
    np.testing.assert_allclose(after[30, 10], 0.2 * J, rtol=1e-5)
    np.testing.assert_allclose(after[30, 60], J, rtol=1e-5)
    np.testing.assert_allclose(after[60, 10], J, rtol=1e-5)  # where the body never was


def test_a_motion_that_is_not_believed_draws_nothing_to_0():
    prior, estimator = prior_of_a_moving_body(), estimator_with(J)
    for q in ([-1.0], [1.0]):
        prior.uncovered(estimator, np.array(q), STANDS, STEP)
        prior.draw(estimator, np.array(q))
    np.testing.assert_allclose(estimator.to_numpy()[30, 10], J, rtol=1e-5)
