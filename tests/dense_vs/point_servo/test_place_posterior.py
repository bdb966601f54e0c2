"""The place of a followed point by three witnesses, beside least squares and by hand."""

import numpy as np
import pytest

from dense_vs.point_servo.place_posterior import off_by_features, place_uncertainty, unseen, untied, with_look

ANYWHERE = 1e6 * np.eye(2)  # px^2
PRIOR = np.array([[0.8, 0.3], [0.3, 0.5]])


def edges(angles, along):
    """What errors of places on edges are multiplied by: 1 across, ``along`` in the edge's direction."""
    across = np.column_stack([np.cos(angles), np.sin(angles)])
    beside = np.column_stack([-np.sin(angles), np.cos(angles)])
    return np.einsum("ki,kj->kij", across, across) + along * np.einsum("ki,kj->kij", beside, beside)


def weighed(prior, off, directions, weights):
    """Rows of a prior about 0 and of every feature, over their deviations."""
    rows, values = [np.linalg.inv(np.linalg.cholesky(prior))], [np.zeros(2)]
    for weight, one, direction in zip(weights, off, directions, strict=True):
        rows.append(np.sqrt(weight) / 0.7 * direction)
        values.append(rows[-1] @ one)
    matrix = np.vstack(rows)
    return np.linalg.lstsq(matrix, np.concatenate(values), rcond=None)[0], np.linalg.inv(matrix.T @ matrix)


def by_least_squares(prior, off, directions, distances):
    """Features alone, twice weighed by how they agree; then with the chain, which may be off by two deviations."""
    near = np.exp(-(distances**2) / (2 * 28.0**2)) + 1e-3
    weights = near
    for _ in range(2):
        mean, _ = weighed(100 * np.eye(2), off, directions, weights)
        apart = [direction @ (one - mean) for one, direction in zip(off, directions, strict=True)]
        weights = near / (1 + np.sum(np.square(apart), axis=1))
    mean, covariance = weighed(100 * np.eye(2), off, directions, weights)
    deviations = mean @ np.linalg.inv(prior + covariance) @ mean
    return weighed(prior * max(1.0, deviations / 4.0), off, directions, weights)


@pytest.mark.parametrize("count", [1, 2, 5, 40])
def test_features_move_a_place_as_least_squares_have_it(count):
    rng = np.random.default_rng(count)
    given = rng.normal(0, 1.5, (count, 2)), edges(rng.uniform(0, np.pi, count), 0.3), rng.uniform(0, 60, count)
    mean, covariance = off_by_features(PRIOR, *given)
    expected, about = by_least_squares(PRIOR, *given)
    np.testing.assert_allclose(mean, expected, atol=1e-9)
    np.testing.assert_allclose(covariance, about, atol=1e-9)


def test_no_features_leave_the_chains_place():
    mean, covariance = off_by_features(PRIOR, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    np.testing.assert_array_equal(mean, 0.0)
    np.testing.assert_array_equal(covariance, PRIOR)


def test_features_along_one_edge_tell_nothing_along_it():
    off = np.array([[2.0, -3.0], [2.2, 1.0], [1.8, 4.0]])
    mean, covariance = off_by_features(9 * np.eye(2), off, edges(np.zeros(3), 0.0), np.zeros(3))
    assert mean[0] == pytest.approx(2.0 / (1 + 0.49 / 27), abs=0.02)  # three of 0.7 px, and a chain of 3 px
    assert mean[1] == 0.0
    assert covariance[0, 0] == pytest.approx(1 / (1 / 9 + 3 / 0.49), abs=0.02)
    assert covariance[1, 1] == pytest.approx(9.0)


def test_a_feature_far_away_and_one_unlike_the_others_count_for_little():
    off, upright = np.array([[1.0, 0.0]] * 4), np.tile(np.eye(2), (4, 1, 1))
    far = np.array([0.0, 0.0, 0.0, 90.0])
    usual, known = off_by_features(ANYWHERE, off, upright, np.zeros(4))
    np.testing.assert_allclose(usual, [1.0, 0.0], atol=1e-5)
    assert off_by_features(ANYWHERE, off, upright, far)[1][0, 0] == pytest.approx(known[0, 0] * 4 / 3, rel=0.01)
    off[3] = [9.0, 9.0]
    assert np.hypot(*(off_by_features(ANYWHERE, off, upright, np.zeros(4))[0] - [1.0, 0.0])) < 0.3


@pytest.mark.parametrize("far", [3.0, 6.0, 12.0])
def test_features_that_agree_are_believed_however_far_off_they_have_the_chain(far):
    off = np.array([[far, 0.1], [far, -0.1], [far + 0.1, 0.0], [-5.0, 5.0]])
    mean, _ = off_by_features(0.25 * np.eye(2), off, np.tile(np.eye(2), (4, 1, 1)), np.zeros(4))
    assert mean[0] == pytest.approx(far, rel=0.15)
    assert abs(mean[1]) < 0.6


def test_features_that_slide_along_their_edges():
    """All are off by (2, -1), and anywhere along their edges; a tenth grossly."""
    rng = np.random.default_rng(0)
    angles = rng.uniform(0, np.pi, 60)
    along = np.column_stack([-np.sin(angles), np.cos(angles)])
    off = np.array([2.0, -1.0]) + rng.normal(0, 0.1, (60, 2)) + along * rng.normal(0, 5, (60, 1))
    off[:6] += 30
    directions = edges(angles, 0.01)
    mean, _ = off_by_features(ANYWHERE, off, directions, np.zeros(60))
    np.testing.assert_allclose(mean, [2, -1], atol=0.2)
    plain, _ = off_by_features(ANYWHERE, off, np.tile(np.eye(2), (60, 1, 1)), np.zeros(60))
    assert np.linalg.norm(plain - [2, -1]) > np.linalg.norm(mean - [2, -1])


@pytest.mark.parametrize(("drift", "deviation"), [(0.0, 0.75), (0.5, 0.75), (0.6, 0.9), (2.0, 3.0)])
def test_a_look_counts_by_its_drift(drift, deviation):
    place, seen = np.array([10.0, 20.0]), np.array([12.0, 17.0])
    found, covariance = with_look(place, PRIOR, seen, drift)
    information = np.linalg.inv(PRIOR) + np.eye(2) / deviation**2
    np.testing.assert_allclose(covariance, np.linalg.inv(information))
    weighted = np.linalg.inv(PRIOR) @ place + seen / deviation**2
    np.testing.assert_allclose(found, np.linalg.solve(information, weighted))


def test_how_well_a_place_is_known_by_hand():
    covariance, offset = np.array([[0.5, 0.1], [0.1, 0.3]]), np.array([0.6, -0.8])  # 1 px
    assert place_uncertainty(covariance, np.zeros(2), True, 0.9) == pytest.approx(np.sqrt(0.09 + 0.4))
    assert place_uncertainty(covariance, offset, True, 0.9) == pytest.approx(np.sqrt(0.09 + 0.4 + 0.81))
    assert place_uncertainty(covariance, 2 * offset, True, 0.9) == pytest.approx(np.sqrt(0.09 + 0.4 + 4 * 0.81))
    assert place_uncertainty(covariance, offset, False, 0.0) == pytest.approx(np.sqrt(0.09 + 0.4 + 0.81 + 1.44))


@pytest.mark.parametrize(
    ("correlation", "off"),
    [(-1.0, 1.2), (0.5, 1.2), (0.8, 1.2), (0.83, 0.96), (0.875, 0.6), (0.905, 0.36), (0.95, 0.36), (1.0, 0.36)],
)
def test_a_place_that_is_not_tied_to_its_own_image_is_known_less_the_less_it_looks_like_it(correlation, off):
    assert untied(correlation) == pytest.approx(off)
    held, loose = (place_uncertainty(np.eye(2), np.zeros(2), *tied) for tied in ((True, 0.9), (False, correlation)))
    assert loose == pytest.approx(np.hypot(held, off))


@pytest.mark.parametrize(
    ("correlation", "off"), [(-1.0, 0.6), (0.4, 0.6), (0.65, 0.6), (0.7, 0.45), (0.8, 0.15), (0.85, 0.0), (1.0, 0.0)]
)
def test_a_place_that_features_tell_is_known_less_where_its_own_look_is_not_seen(correlation, off):
    assert unseen(correlation) == pytest.approx(off, abs=1e-12)
    seen, not_seen = (place_uncertainty(np.eye(2), np.zeros(2), True, at) for at in (0.9, correlation))
    assert not_seen == pytest.approx(np.hypot(seen, off))
