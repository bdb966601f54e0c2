"""Where the joints' lines of a chain point to: hinges, slides and what is neither."""

import numpy as np
from scipy.spatial.transform import Rotation

from dense_vs.body_model.chain import Chain


def test_a_hinge_s_direction_is_its_axis_a_slide_s_its_shift_and_one_that_is_neither_s_is_forward():
    axes = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    travel = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, -4.0], [0.0, 0.0, 0.0]])
    chain = Chain(axes, np.ones((3, 3)), np.zeros(3), np.array([-1, 0, 1]), travel)
    np.testing.assert_array_equal(chain.slides, [False, True, True])
    np.testing.assert_allclose(chain.directions, [[0.0, 0.6, 0.8], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])


def test_in_another_unit_lines_stay_and_their_points_are_those_next_to_the_camera():
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes[3] = 0.0
    travel = np.zeros((4, 3))
    travel[3] = [0.2, -0.5, 0.1]
    chain = Chain(axes, rng.normal(size=(4, 3)), np.full(4, 0.3), np.array([-1, 0, 1, 2]), travel)
    larger = chain.scaled(2.5)
    for axis, point, found in zip(axes[:3], chain.points, larger.points, strict=False):
        ways = np.linspace(-9.0, 9.0, 18001)
        along = 2.5 * (point + ways[:, None] * axis)
        nearest = along[np.argmin(np.linalg.norm(along, axis=1))]
        np.testing.assert_allclose(found, nearest, atol=2e-3)
        np.testing.assert_allclose(found @ axis, 0.0, atol=1e-12)
    np.testing.assert_allclose(larger.travel, 2.5 * travel)
    np.testing.assert_array_equal(larger.axes, axes)
    q = np.array([[0.5, -0.2, 0.9, 1.1]])
    for one, other in zip(chain.link_poses(q), larger.link_poses(q), strict=True):
        np.testing.assert_allclose(other, one if one.ndim == 4 else 2.5 * one, atol=1e-12)


def test_lines_of_many_steps_at_once_are_turned_about_their_points_and_shifted():
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes[2], travel = 0.0, np.zeros((3, 3))
    travel[2] = [0.2, -0.5, 0.1]
    chain = Chain(axes, rng.normal(size=(3, 3)), np.zeros(3), np.array([-1, 0, 1]), travel)
    steps = 0.3 * rng.normal(size=(5, 3, 4))
    steps[0] = 0.0
    found = chain.moved_lines(steps)
    for k, step in enumerate(steps):
        one = chain.moved(step)
        for many, alone in zip(found, (one.axes, one.points, one.travel), strict=True):
            np.testing.assert_allclose(many[k], alone, atol=1e-14)
        for n in (0, 1):
            turn = Rotation.from_rotvec(step[n, :2] @ chain.across[n]).as_matrix()
            np.testing.assert_allclose(one.axes[n], turn @ axes[n], atol=1e-14)
            np.testing.assert_allclose(one.points[n], chain.points[n] + step[n, 2:] @ chain.across[n], atol=1e-14)
            np.testing.assert_array_equal(one.travel[n], 0.0)
        np.testing.assert_array_equal(one.axes[2], 0.0)
        np.testing.assert_array_equal(one.points[2], chain.points[2])
        np.testing.assert_allclose(one.travel[2], travel[2] + step[2, :3], atol=1e-14)
