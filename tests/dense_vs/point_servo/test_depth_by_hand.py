"""A point's depth beside its formula, and what a follower and a tracker say, by hand."""

import numpy as np
import pytest

from dense_vs.point_servo import point_depth as depths
from dense_vs.point_servo.point_depth import PointDepth, depth_of_features, point_depth, together, tried_depths


def reference(places, values, point):
    """Five rounds of a plane through inverse depths; weights fall with distance (20 px) and with being unlike.

    Slopes are drawn to none: 0.003 a px is as usual as 0.03 of the depth.
    """
    away = places - point
    near = np.exp(-np.sum(away**2, axis=1) / (2 * 20.0**2)) + 1e-4
    inverse = 1 / values
    usual, weights = np.sum(near * inverse) / near.sum(), near
    for _ in range(5):
        rows = np.sqrt(weights)[:, None] * np.column_stack([np.ones(len(values)), away])
        rows = np.vstack([rows, 10.0 * np.eye(3)[1:]])
        plane = np.linalg.lstsq(rows, np.append(np.sqrt(weights) * inverse, [0.0, 0.0]), rcond=None)[0]
        off = inverse - plane[0] - away @ plane[1:]
        spread = np.sqrt(np.sum(weights * off**2) / weights.sum())
        weights = near / (1 + (off / max(1.5 * spread, 1e-4 * usual)) ** 2)
    apart = min(np.hypot(*one) for one in away)
    return 1 / plane[0], np.sqrt(max(spread / usual, 0.03) ** 2 + (0.0015 * apart) ** 2), -plane[1:] / plane[0]


@pytest.mark.parametrize("seed", range(5))
def test_depth_of_features_is_its_formula(seed):
    rng = np.random.default_rng(seed)
    places, values, point = rng.uniform(0, 80, (20, 2)), rng.uniform(0.8, 1.6, 20), rng.uniform(20, 60, 2)
    found = depth_of_features(places, values, point)
    depth, deviation, slope = reference(places, values, point)
    assert (found.depth, found.deviation) == pytest.approx((depth, deviation), rel=1e-9)
    np.testing.assert_allclose(found.slope, slope, atol=1e-9)
    places[7] = point + np.array([6.0, 8.0])
    near = depth_of_features(places[7:8].repeat(3, axis=0), np.full(3, 1.3), point)
    assert (near.depth, near.deviation) == pytest.approx((1.3, np.hypot(0.03, 0.015)))


def test_features_to_one_side_of_a_point_tell_its_depth_on_a_plane_that_is_aslant():
    away = np.random.default_rng(0).uniform([5, -20], [30, 20], (200, 2))  # all to the right
    point, slope = np.array([100.0, 80.0]), np.array([0.002, -0.001])
    found = depth_of_features(point + away, 1.5 / (1 - away @ slope), point)
    assert found.depth == pytest.approx(1.5, rel=0.003)
    np.testing.assert_allclose(found.slope, slope, rtol=0.1)


def test_a_plane_that_would_pass_far_behind_the_features_goes_no_farther():
    away = np.tile([[10.0, 0.0], [11.0, 0.0], [20.0, 0.0], [21.0, 0.0]], (60, 1))
    inverse = np.tile([0.5, 0.6, 1.5, 1.6], 60)
    found = depth_of_features(away, 1 / inverse, np.zeros(2))
    usual = np.average(inverse, weights=np.exp(-(away[:, 0] ** 2) / 800) + 1e-4)
    assert found.depth == pytest.approx(2 / usual)


def test_two_sources_count_by_their_certainty_and_are_doubted_where_they_disagree():
    one, other = PointDepth(2.0, 0.03), PointDepth(2.0 * np.exp(0.02), 0.06)
    both = together(one, other)
    assert np.log(both.depth / 2.0) == pytest.approx(0.02 * 0.03**2 / (0.03**2 + 0.06**2))
    assert both.deviation == pytest.approx(0.03 * 0.06 / np.hypot(0.03, 0.06))
    assert together(other, one).depth == pytest.approx(both.depth)
    far = together(one, PointDepth(2.0 * np.exp(0.2), 0.06))  # they are 0.2 apart where 0.067 is usual
    assert far.deviation == pytest.approx(both.deviation * 0.2 / np.hypot(0.03, 0.06))
    assert together(one, None) is one
    assert together(None, other) is other
    assert together(None, None) is None


@pytest.mark.parametrize(("count", "enough"), [(2, False), (3, True)])
def test_three_features_are_enough(count, enough):
    found = depth_of_features(np.zeros((count, 2)), np.full(count, 2.0), np.zeros(2))
    assert (found is not None) == enough


def test_depths_are_tried_a_quarter_about_that_around():
    tried = tried_depths(PointDepth(2.0, 0.1))
    assert len(tried) == 251
    np.testing.assert_allclose(tried[[0, 125, 250]], 2.0 * np.exp([-0.25, 0.0, 0.25]))


def cost(around, errors, steps):
    counted = max(1.0, errors.shape[1] / 10)
    return np.log1p((errors / 0.5) ** 2).sum(axis=1) / counted + (steps / around.deviation) ** 2


@pytest.mark.parametrize("places", [0, 1, 5, 10, 40])
@pytest.mark.parametrize("true", [-0.12, 0.0, 0.06, 0.3])
def test_the_most_likely_depth_weighs_own_places_and_those_around(places, true):
    """At most ten places count in full; the curvature of the cost about its least is the certainty, but for an error of
    0.018 that all own places share: what they say is of a Gaussian that is wider by that.
    """
    around, steps = PointDepth(1.5, 0.08), np.linspace(-0.25, 0.25, 251)
    errors = np.abs(steps - true)[:, None] * np.linspace(5.0, 60.0, places)
    found = point_depth(around, errors)
    expected = cost(around, errors, steps)
    best = int(np.argmin(expected))
    middle = min(max(best, 5), 245)
    size = steps[1] - steps[0]
    bend = (expected[middle - 5] - 2 * expected[middle] + expected[middle + 5]) / (5 * size) ** 2
    together = 1 / max(bend / 2, 16.0)
    share, variance = 1.0, together
    if places and together < 0.08**2:
        own = 1 / (1 / together - 0.08**-2)  # variance of the own places alone
        wider = own + 0.018**2
        share = (0.08**2 + own) / (0.08**2 + wider)  # of the way that they would move it by were they not wider
        variance = 1 / (0.08**-2 + 1 / wider)
    assert np.log(found.depth / 1.5) == pytest.approx(share * steps[best])
    assert found.deviation == pytest.approx(np.sqrt(variance))
    assert 0 < found.deviation <= 0.251


def test_without_any_place_the_deviation_is_that_around():
    found = point_depth(PointDepth(1.0, 0.05), np.zeros((251, 0)))
    assert found.deviation == pytest.approx(0.05, rel=1e-6)
    assert point_depth(PointDepth(1.0, 10.0), np.zeros((251, 0))).deviation == 0.25  # nothing tells
    assert depths.UNKNOWN == 0.25
