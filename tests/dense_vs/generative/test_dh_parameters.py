"""Denavit and Hartenberg's parameters against plain turns and shifts."""

from types import SimpleNamespace

import numpy as np
import pytest
from exact_arm import carried, exact_arm
from scipy.spatial.transform import Rotation

from dense_vs.generative.kinematics.denavit_hartenberg import DHProblem, from_lines, to_lines, transforms, with_dh
from dense_vs.generative.least_squares.pixel_problem import Free, PixelProblem, PixelState


@pytest.fixture(scope="module")
def arm():
    return exact_arm()


def test_a_transform_is_four_plain_motions():
    """Turn about z, shift along it, shift along x, turn about x."""
    omega, d, a, alpha, q = 0.3, 0.2, -0.4, 0.7, np.array([0.5, -1.1])
    for angle, found in zip(q, transforms(np.array([omega, d, a, alpha]), q), strict=True):
        turn = Rotation.from_euler("z", omega + angle).as_matrix()
        expected = np.eye(4)
        expected[:3, :3] = turn @ Rotation.from_euler("x", alpha).as_matrix()
        expected[:3, 3] = turn @ [a, 0, 0] + [0, 0, d]
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["skew", "parallel", "same line", "crossing"])
def test_lines_become_parameters_and_lines_again(kind):
    """Also where two axes are parallel, where d is not determined and taken as 0."""
    axes = np.array([[0.0, 0.0, 1.0], [0.8, 0.6, 0.0], [0.0, 0.6, 0.8]])
    points = np.array([[0.05, 0.0, 0.0], [0.0, 0.1, 0.2], [0.1, 0.0, 0.4]])
    if kind == "parallel":
        axes[1] = axes[0]
    elif kind == "same line":
        axes[1], points[1] = axes[0], points[0] + [0, 0, 0.7]
    elif kind == "crossing":
        points[1] = points[0] + 0.3 * axes[0]
    home = np.array([0.2, -0.5, 0.9])
    dh = from_lines(axes, points, home)
    near = np.array([0.3, -0.2, 0.6])
    found, at = to_lines(dh, home, near)
    np.testing.assert_allclose(found, axes, atol=1e-9)
    np.testing.assert_allclose(np.cross(at - points, axes), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.einsum("ni,ni->n", at - near, axes), 0.0, atol=1e-9)
    if kind in ("parallel", "same line"):
        assert dh.table[0, 1] == 0.0
    # The links move as turns about the lines say.
    q = home + np.array([0.4, -0.3, 0.2])
    before, after = dh.frames(home[None])[0], dh.frames(q[None])[0]
    np.testing.assert_allclose(before[3], before[2], atol=1e-12)  # the hand's frame at home is its joint's
    none = {"base_rotation": np.eye(3), "base_translation": np.zeros(3)}
    arm = SimpleNamespace(axes=axes, points=points, home=home, **none)
    for link in range(4):
        inside = np.linalg.inv(before[link]) @ [0.1, 0.2, 0.3, 1.0]
        np.testing.assert_allclose((after[link] @ inside)[:3], carried(arm, q, link, [0.1, 0.2, 0.3]), atol=1e-9)


@pytest.mark.parametrize("local", ["none", "joints"])
def test_the_gradient_in_these_parameters_is_that_of_the_cost(arm, local):
    p = arm.parameters
    rng = np.random.default_rng(1)
    cameras = np.array([False, True])
    free = Free(kinematics=True, features=True, cameras=cameras, intrinsics=cameras)
    problem = PixelProblem(arm.pixels + rng.normal(size=arm.pixels.shape), p.links, 3, free, local)
    dh = DHProblem(problem)
    state = with_dh(PixelState(p.copy(), arm.joints.copy()), from_lines(p.axes, p.points, p.home))
    equations = dh.linearize(state)
    assert equations.cost == pytest.approx(dh.cost(state))
    count = len(equations.shared_gradient)
    assert (dh.lines, dh.own) == (12, 14)
    assert count == 14 + problem.count - 12
    blocks = None if equations.local is None else np.zeros((len(arm.joints), equations.local.shape[1]))

    def residual(step):
        return problem.residuals(dh.move(state, step, blocks)).ravel().copy()

    J = np.stack([(residual(1e-6 * d) - residual(-1e-6 * d)) / 2e-6 for d in np.eye(count)], axis=1)
    here = residual(np.zeros(count))
    scale = np.sqrt((J**2).sum(axis=0))
    np.testing.assert_allclose(equations.shared_gradient / scale, J.T @ here / scale, atol=1e-2)
    np.testing.assert_allclose(equations.shared / np.outer(scale, scale), J.T @ J / np.outer(scale, scale), atol=1e-5)
    if local == "joints":
        for t, n in ((0, 0), (5, 2)):
            own = np.zeros_like(blocks)
            own[t, n] = 1e-6
            still = np.zeros(count)
            up, down = (problem.residuals(dh.move(state, still, s * own)).ravel().copy() for s in (1, -1))
            column = (up - down) / 2e-6
            np.testing.assert_allclose(equations.coupling[t, n] / scale, column @ J / scale, rtol=1e-4, atol=1e-2)


def test_kinematics_that_are_known_have_no_such_parameters(arm):
    with pytest.raises(ValueError, match="not free"):
        DHProblem(PixelProblem(arm.pixels, arm.parameters.links, 3, Free(features=True)))
