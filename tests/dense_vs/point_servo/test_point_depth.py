"""A point's depth from features around it and from its own places, against exact ones."""

import numpy as np
import pytest

from dense_vs.point_servo.point_depth import (
    LEAST_INVERSE,
    LEAST_SPREAD,
    NEAR,
    RANGE,
    RELIEF,
    SLOPE,
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


def reference_depth(places, depths, point):
    """Five rounds of a weighted fit of inverse depth to a plane, in which a slope costs what its prior says."""
    away = places - point
    near = np.exp(-0.5 * (np.hypot(*away.T) / NEAR) ** 2) + 1e-4
    usual = np.sum(near / depths) / np.sum(near)
    prior = LEAST_SPREAD / SLOPE * np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    weights = near
    for _ in range(5):
        root = np.sqrt(weights)
        design = np.vstack([root[:, None] * np.column_stack([np.ones(len(away)), away]), prior])
        plane = np.linalg.lstsq(design, np.append(root / depths, [0.0, 0.0]), rcond=None)[0]
        off = 1 / depths - plane[0] - away @ plane[1:]
        spread = np.sqrt(np.sum(weights * off**2) / np.sum(weights))
        weights = near / (1 + (off / max(1.5 * spread, 1e-4 * usual)) ** 2)
    here = max(plane[0], LEAST_INVERSE * usual)
    deviation = np.hypot(max(spread / usual, LEAST_SPREAD), RELIEF * np.hypot(*away.T).min())
    return 1 / here, deviation, -plane[1:] / here


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("kind", ["around", "aside", "falling away", "flat", "smooth", "exact", "gross", "three"])
def test_depth_of_features_is_that_of_a_robust_plane_in_any_unit(kind, unit):
    rng = np.random.default_rng(5)
    point = np.array([60.0, 45.0])
    places = point + rng.normal(0.0, 12.0, (15, 2)) + ([30.0, -8.0] if kind in ("aside", "falling away") else 0.0)
    away = places - point
    level = kind in ("flat", "exact", "smooth")
    slope = [0.0, 0.0] if level else [0.025, 0.0] if kind == "falling away" else [0.004, -0.006]
    noise = {"flat": 0.0, "exact": 2e-5, "smooth": 3e-4}.get(kind, 0.03)
    inverse = 0.8 + away @ slope + rng.normal(0.0, noise, 15)
    if kind == "gross":
        inverse[:3] = [2.5, 0.2, 1.7]
    depths = unit / inverse
    if kind == "three":
        places, depths = places[:3], depths[:3]
    found = depth_of_features(places, depths, point)
    depth, deviation, tilt = reference_depth(places, depths, point)
    assert found is not None
    assert found.depth == pytest.approx(depth, rel=1e-9)
    assert found.deviation == pytest.approx(deviation, rel=1e-9)
    np.testing.assert_allclose(found.slope, tilt, rtol=1e-6, atol=1e-12)


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
