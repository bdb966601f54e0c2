"""J of a feature by the chain's screws, against differences of its projection in float64."""

import numpy as np
import pytest

from dense_vs.body_model.chain import BACKGROUND, Chain
from dense_vs.body_model.lens import Lens
from dense_vs.point_servo.body_features import BodyFeatures

PARENTS = np.array([-1, 0, 1, 1])  # a branch: link 2 is not moved by joint 3
SMALL = 1e-5  # rad


def features_of(seed, learned=(True, True, True, True), bend=0.0):
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    points = rng.normal(size=(4, 3)) * 0.3 + [0, 0, 2.0]
    chain = Chain(axes, points, rng.normal(size=4), PARENTS)
    features = BodyFeatures(chain, 300.0, np.array([160.0, 120.0]), np.array(learned))
    features.lens = Lens.of_center(features.center, bend)
    features.added(5)
    features.links = np.array([0, 1, 2, 3, BACKGROUND])
    features.points = rng.normal(size=(5, 3)) * 0.2 + [0, 0, 2.0]
    return features, rng.normal(size=4) * 0.4 + chain.home


def by_differences(features, feature, q):
    one = np.array([feature])
    columns = [features.project(one, q + step)[0] - features.project(one, q - step)[0] for step in SMALL * np.eye(4)]
    return np.stack(columns, axis=1) / (2 * SMALL)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("feature", range(5))
@pytest.mark.parametrize("bend", [0.0, -0.08])
def test_it_is_the_derivative_of_the_projection(seed, feature, bend):
    features, q = features_of(seed, bend=bend)
    J = features.jacobian(feature, q)
    assert J.shape == (2, 4)
    expected = by_differences(features, feature, q)
    np.testing.assert_allclose(J, expected, rtol=1e-6, atol=1e-5)  # px/rad, of up to some hundred
    moved = features.chain.moved_by[features.links[feature]]
    assert (np.abs(J).max(axis=0) > 1)[moved].all()
    assert not J[:, ~moved].any()


def test_a_joint_that_is_not_learned_has_no_part():
    features, q = features_of(0, (True, False, True, True))
    J = features.jacobian(2, q)
    np.testing.assert_allclose(J, by_differences(features, 2, q) * [1, 0, 1, 1], rtol=1e-6, atol=1e-5)


def test_behind_the_camera_it_is_zero():
    features, q = features_of(0)
    features.points[4] = [0.1, 0.1, -1.0]
    assert not features.jacobian(4, q).any()
    features.links[4] = 3
    position = features.positions(np.array([3]), q)[0]
    features.points[4] = features.points[3] - features.chain.link_poses(q[None])[0][0, 3].T @ [0, 0, position[2] + 1]
    assert features.positions(np.array([4]), q)[0, 2] < 0
    assert not features.jacobian(4, q).any()
