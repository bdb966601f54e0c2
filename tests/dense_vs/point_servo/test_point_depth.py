"""A point's depth from features around it and from its own places, against exact ones."""

import numpy as np

from dense_vs.point_servo.point_depth import (
    LEAST_SPREAD,
    RANGE,
    STEPS,
    PointDepth,
    depth_of_features,
    point_depth,
    tried_depths,
)


def test_features_near_the_point_count_and_gross_ones_hardly():
    rng = np.random.default_rng(0)
    near = rng.normal([50.0, 40.0], 5.0, (20, 2))
    places = np.vstack([near, rng.normal([200.0, 40.0], 5.0, (20, 2)), [[51.0, 40.0]]])
    depths = np.concatenate([rng.normal(1.0, 0.01, 20), rng.normal(3.0, 0.01, 20), [9.0]])
    found = depth_of_features(places, depths, np.array([50.0, 40.0]))
    assert found is not None
    assert abs(found.depth - 1.0) < 0.02
    assert found.deviation >= LEAST_SPREAD


def test_too_few_features_tell_nothing():
    assert depth_of_features(np.zeros((2, 2)), np.ones(2), np.zeros(2)) is None


def test_own_places_decide_where_they_tell_more():
    around = PointDepth(1.0, 0.1)
    tried = tried_depths(around)
    assert tried.shape == (STEPS,)
    np.testing.assert_allclose(np.log(tried[[0, -1]]), [-RANGE, RANGE])
    true = 1.08
    errors = np.abs(np.log(tried / true))[:, None] * np.full(20, 200.0)  # px
    found = point_depth(around, errors)
    assert abs(found.depth / true - 1) < 0.011
    assert found.deviation < 0.02


def test_without_own_places_the_features_decide():
    around = PointDepth(2.0, 0.05)
    found = point_depth(around, np.zeros((STEPS, 0)))
    assert abs(found.depth - 2.0) < 1e-9
    assert abs(found.deviation - 0.05) < 1e-3
