"""The link of a point by J: on chains at random, against J of points that are carried by plain differences."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo.point_link import left_by_links, link_of_point
from dense_vs.point_servo.surface_place import SurfacePlace

FOCAL, CENTER = 280.0, np.array([159.5, 119.5])
PARENTS = np.array([-1, 0, 1, 1])  # a branch: link 2 is not moved by joint 3, nor link 3 by joint 2


def model_of(seed, learned=(True, True, True, True)):
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    points = rng.normal(size=(4, 3)) * 0.3 + [0, 0, 2.0]
    chain = Chain(axes, points, rng.normal(size=4), PARENTS)
    model = SimpleNamespace(chain=chain, learned=np.array(learned), focal_length=FOCAL, center=tuple(CENTER))
    model.rays = lambda pixels: np.column_stack([(pixels - CENTER) / FOCAL, np.ones(len(pixels))])
    return model, rng


def pixel(model, link, home, q):
    rotation, translation = model.chain.link_poses(q[None])
    here = rotation[0, link] @ home + translation[0, link]
    return FOCAL * here[:2] / here[2] + CENTER


def seen(model, link, home, q):
    """The pixel of a point, and its J by differences."""
    steps = [pixel(model, link, home, q + d) - pixel(model, link, home, q - d) for d in 1e-6 * np.eye(4)]
    return pixel(model, link, home, q), np.stack(steps, axis=1) / 2e-6


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("link", range(4))
def test_j_tells_the_link(seed, link):
    model, rng = model_of(seed)
    q = model.chain.home + rng.normal(0, 0.4, 4)
    point, J = seen(model, link, rng.normal(size=3) * 0.2 + [0, 0, 2.0], q)
    left = left_by_links(model, J, q, point)
    assert list(left) == [0, 1, 2, 3]
    assert left[link] == pytest.approx(0.0, abs=1e-6)
    assert min(share for other, share in left.items() if other != link) > 1e-3
    assert link_of_point(model, J, q, point, None) == link
    noisy = J + 0.02 * np.linalg.norm(J) * rng.normal(size=J.shape)
    assert left_by_links(model, noisy, q, point)[link] < 0.1


@pytest.mark.parametrize("link", range(4))
def test_a_depth_behind_the_camera_is_taken_for_a_thousand(link):
    """J is linear in the depth's inverse, which is at least a thousandth."""
    model, rng = model_of(1)
    q = model.chain.home + rng.normal(0, 0.4, 4)
    rotation, translation = (pose[0, link] for pose in model.chain.link_poses(q[None]))
    ray = np.array([0.05, -0.08, 1.0])
    near, far = (seen(model, link, rotation.T @ (depth * ray - translation), q) for depth in (1.0, 2.0))
    np.testing.assert_allclose(near[0], far[0])
    shift = 2 * (near[1] - far[1])
    J = near[1] - 1.5 * shift  # of an inverse of -0.5
    left = left_by_links(model, J, q, near[0])[link]
    assert left == pytest.approx(0.501 * np.linalg.norm(shift) / np.linalg.norm(J), rel=1e-4)


def test_the_share_that_is_left_is_that_of_the_best_depth():
    """By trying depths."""
    model, rng = model_of(3)
    q = model.chain.home + rng.normal(0, 0.4, 4)
    point, J = seen(model, 3, np.array([0.1, -0.1, 1.9]), q)
    J = J + 0.2 * np.linalg.norm(J) * rng.normal(size=J.shape)
    left = left_by_links(model, J, q, point)
    ray = np.append((point - CENTER) / FOCAL, 1.0)
    for link in range(4):
        tried = []
        for depth in np.geomspace(0.05, 900.0, 4000):
            v = model.chain.velocities(q, (depth * ray)[None], np.array([link]))[0]
            there = FOCAL / depth * (v[:, :2] - ray[:2] * v[:, 2:]).T
            tried.append(np.linalg.norm(there - J) / np.linalg.norm(J))
        assert left[link] == pytest.approx(min(tried), abs=2e-3)


def test_a_joint_that_is_not_learned_says_nothing():
    model, rng = model_of(1, (True, False, True, True))
    q = model.chain.home + rng.normal(0, 0.4, 4)
    point, J = seen(model, 3, np.array([0.1, -0.1, 1.9]), q)
    J[:, 1] = 1e6
    left = left_by_links(model, J, q, point)
    assert list(left) == [0, 2, 3]
    assert left[3] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("left", "surface", "expected"),
    [
        ({0: 0.4, 1: 0.2, 2: 0.3}, None, 1),
        ({0: 0.4, 1: 0.2, 2: 0.3}, (0, 1.0), 1),  # J says clearly more of another link
        ({0: 0.4, 1: 0.2, 2: 0.24}, (2, 1.0), 2),  # as good
        ({0: 0.4, 1: 0.2, 2: 0.26}, (2, 1.0), 1),
        ({0: 0.9, 1: 0.51}, (0, 1.0), 0),  # no link explains J
        ({0: 0.9, 1: 0.49}, (0, 1.0), 1),
        ({0: 0.9, 1: 0.51}, None, None),
        ({0: np.nan}, (2, 1.0), 2),
        ({}, (2, 1.0), 2),
        ({}, None, None),
        ({1: 0.2}, (3, 1.0), 1),  # of a joint that is not learned
    ],
)
def test_j_and_surface_together(monkeypatch, left, surface, expected):
    monkeypatch.setattr("dense_vs.point_servo.point_link.left_by_links", lambda *given: left)
    place = surface and SurfacePlace(*surface)
    assert link_of_point(None, None, None, None, place) == expected


@pytest.mark.parametrize("J", [np.zeros((2, 4)), np.full((2, 4), np.nan)])
def test_where_nothing_moves_j_says_nothing(J):
    model, _ = model_of(0)
    assert left_by_links(model, J, model.chain.home, CENTER) == {}
