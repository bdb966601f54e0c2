"""A second camera's pose, and a camera by known points, each step by itself on exact cases."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.generative.reconstruction import relative_pose, resection

HOME = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()


def turns(rng, count):
    return Rotation.from_rotvec(rng.normal(size=(count, 3))).as_matrix()


def matches(rng, noise=0.0):
    points = rng.normal(size=(40, 3)) + np.array([0, 0, 5.0])
    rotation, shift = Rotation.from_rotvec([0.1, 0.4, -0.2]).as_matrix(), np.array([0.8, -0.2, 0.3])
    other = points @ rotation.T + shift
    first, second = points[:, :2] / points[:, 2:], other[:, :2] / other[:, 2:]
    return first, second + noise * rng.normal(size=second.shape), rotation, shift / np.linalg.norm(shift)


def test_sampson_s_distance_is_the_residual_over_its_gradient():
    """By central differences over the four coordinates of each match."""
    rng = np.random.default_rng(14)
    first, second, rotation, shift = matches(rng, 0.01)
    essential = relative_pose._essential(rotation, shift)
    skew = np.array([np.cross(shift, column) for column in np.eye(3)]).T
    np.testing.assert_allclose(essential, skew @ rotation, atol=1e-12)

    def constraint(x, y):
        return np.append(y, 1.0) @ essential @ np.append(x, 1.0)

    found = relative_pose._sampson(essential, first, second)
    for k in range(5):
        slopes = []
        for d in 1e-6 * np.eye(4):
            up = constraint(first[k] + d[:2], second[k] + d[2:])
            slopes.append((up - constraint(first[k] - d[:2], second[k] - d[2:])) / 2e-6)
        assert found[k] == pytest.approx(constraint(first[k], second[k]) / np.linalg.norm(slopes), rel=1e-6)


def test_the_decomposition_of_an_essential_matrix_is_before_both_cameras_despite_some_mistakes():
    rng = np.random.default_rng(15)
    first, second, rotation, shift = matches(rng)
    second[:12] = rng.normal(size=(12, 2))
    found, direction = relative_pose._decomposed(relative_pose._essential(rotation, shift), first, second)
    np.testing.assert_allclose(found, rotation, atol=1e-6)
    np.testing.assert_allclose(direction, shift, atol=1e-6)


def test_a_refined_pose_is_the_truth_and_its_cost_is_robust():
    rng = np.random.default_rng(16)
    first, second, rotation, shift = matches(rng)
    second[:6] += 0.5
    begun = Rotation.from_rotvec([0.03, -0.02, 0.04]).as_matrix() @ rotation
    cost, found, direction = relative_pose._refined(begun, shift + np.array([0.05, 0.05, -0.1]), first, second, 600.0)
    np.testing.assert_allclose(found, rotation, atol=1e-3)
    np.testing.assert_allclose(direction, shift, atol=1e-3)
    distance = 600.0 * relative_pose._sampson(relative_pose._essential(rotation, shift), first, second)
    assert cost == pytest.approx(0.5 * np.sum(np.log1p(distance**2)), rel=1e-3)  # Cauchy's loss at a scale of 1 px


def test_poses_are_apart_by_the_larger_of_two_angles():
    one = (HOME, np.array([1.0, 0.0, 0.0]))
    turned = (Rotation.from_rotvec([0, 0.3, 0]).as_matrix() @ HOME, np.array([np.cos(0.1), np.sin(0.1), 0.0]))
    shifted = (HOME, np.array([np.cos(0.2), 0.0, np.sin(0.2)]))
    assert relative_pose._apart(one, turned) == pytest.approx(0.3)
    assert relative_pose._apart(one, shifted) == pytest.approx(0.2)
    assert relative_pose._apart(one, one) == pytest.approx(0.0, abs=1e-7)
    assert relative_pose._apart(one, (HOME, -one[1])) == pytest.approx(np.pi)


def test_the_first_pose_is_the_truth_and_further_ones_are_apart():
    rng = np.random.default_rng(17)
    first, second, rotation, shift = matches(rng, 0.0005)
    poses = list(relative_pose.relative_poses(first, second, 600.0, rng))
    np.testing.assert_allclose(poses[0][0], rotation, atol=0.01)
    np.testing.assert_allclose(poses[0][1], shift, atol=0.02)
    for k, pose in enumerate(poses):
        assert all(relative_pose._apart(pose, other) > 0.05 for other in poses[:k])


def test_solutions_stacked_by_opencv_are_split():
    stack = np.arange(18.0).reshape(6, 3)
    np.testing.assert_array_equal(relative_pose._split(stack), stack.reshape(2, 3, 3))
    stack[4, 1] = np.nan
    np.testing.assert_array_equal(relative_pose._split(stack), stack[None, :3])
    assert relative_pose._split(None) == []
    assert relative_pose._split(np.zeros((3, 4))) == []


@pytest.mark.parametrize(("count", "wrong", "seed"), [(20, 3, 0), (12, 2, 1), (20, 3, 2), (6, 0, 0)])
def test_a_camera_is_resected_despite_mistakes(count, wrong, seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    rotation, shift = turns(rng, 1)[0], np.array([0.2, -0.1, 5.0])
    here = points @ rotation.T + shift
    flat = here[:, :2] / here[:, 2:]
    flat[:wrong] += rng.choice([-0.07, 0.07], (wrong, 2))
    found = resection.resect(points, flat)
    np.testing.assert_allclose(found[0], rotation, atol=1e-3)
    np.testing.assert_allclose(found[1], shift, atol=1e-2)


def test_points_that_have_no_camera():
    assert resection.resect(np.zeros((5, 3)), np.zeros((5, 2))) is None


def test_a_refined_camera_has_most_points_ahead_and_tells_its_errors():
    rng = np.random.default_rng(19)
    points = rng.normal(size=(6, 3))
    turn, shift = np.array([[0.2], [0.1], [-0.3]]), np.array([[0.1], [0.2], [6.0]])
    rotation = Rotation.from_rotvec(turn[:, 0]).as_matrix()
    here = points @ rotation.T + shift[:, 0]
    flat = here[:, :2] / here[:, 2:]
    flat[0] += [0.3, 0.4]
    found, at, errors = resection._refined(points, flat, turn + 1e-3, shift + 1e-3)
    np.testing.assert_allclose(found, rotation, atol=1e-5)  # the first one is no part of the refinement
    np.testing.assert_allclose(at, shift[:, 0], atol=1e-4)
    np.testing.assert_allclose(errors, [0.5, 0, 0, 0, 0, 0], atol=1e-5)
    behind = resection._refined(points, flat, turn, -shift)
    assert behind is None
