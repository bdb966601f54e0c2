"""Errors of a point's place against plain differences: chains that are moved a little, posed whole and projected."""

import numpy as np
import pytest

from dense_vs.body_model.chain import Chain
from dense_vs.point_servo.body_features import BodyFeatures
from dense_vs.point_servo.place_errors import LINES, UNSEEN, PlaceErrors
from dense_vs.point_servo.point_depth import PointDepth
from dense_vs.point_servo.surface_place import SurfacePlace

FOCAL, CENTER = 300.0, np.array([159.5, 119.5])
PIXEL, DEPTH = np.array([201.0, 88.0]), PointDepth(1.9, 0.017)
LINK = 3
STEP = 1e-5


def body(seed):
    """Hinges 0, 1 and 3, a slide 2; joint 4 is a branch that the point is not on."""
    random = np.random.default_rng(seed)
    axes = random.normal(size=(5, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    travel = np.zeros((5, 3))
    travel[2], axes[2] = [0.3, -0.2, 0.4], 0.0
    points = np.array([0, 0, 2.2]) + 0.3 * random.normal(size=(5, 3))
    chain = Chain(axes, points, 0.2 * random.normal(size=5), np.array([-1, 0, 1, 2, 1]), travel)
    return BodyFeatures(chain, FOCAL, CENTER, np.ones(5, bool)), random


def place(chain, focal, log_depth, defined, posture):
    """Where the point is in a posture that is at its pixel where it was defined, at a depth that is farther so much."""
    ray = np.append((PIXEL - CENTER) / focal, 1.0)
    rotation, translation = chain.link_poses(np.array([defined, posture]))
    home = rotation[0, LINK].T @ (DEPTH.depth * np.exp(log_depth) * ray - translation[0, LINK])
    there = rotation[1, LINK] @ home + translation[1, LINK]
    return CENTER + focal * there[:2] / there[2]


@pytest.mark.parametrize("seed", range(3))
def test_errors_are_those_of_chains_that_are_moved(seed):
    features, random = body(seed)
    chain = features.chain
    lines, follows = 0.01 * random.normal(size=(4, 21)), 0.02 * random.normal(size=4)
    defined = chain.home + 0.3 * random.normal(size=5)
    errors = PlaceErrors(features, PIXEL, defined, DEPTH, SurfacePlace(LINK, 1.8, (lines, follows)), LINK)
    postures = chain.home + 0.4 * random.normal(size=(6, 5))
    found = errors(postures)
    assert found.shape == (6, 5, 2)
    for t, q in enumerate(postures):
        for r, (line, log_depth) in enumerate(zip(lines, follows, strict=True)):
            after, before = (
                place(
                    chain.moved(step * line[:-1].reshape(5, 4)), FOCAL * np.exp(step * line[-1]), step * log_depth,
                    defined, q,
                )
                for step in (STEP, -STEP)
            )  # fmt: skip
            np.testing.assert_allclose(found[t, r], LINES * (after - before) / (2 * STEP), rtol=0.02, atol=0.02)
        after, before = (place(chain, FOCAL, step * DEPTH.deviation, defined, q) for step in (STEP, -STEP))
        np.testing.assert_allclose(found[t, -1], (after - before) / (2 * STEP), rtol=0.02, atol=0.02)


def test_where_it_was_defined_its_place_is_known():
    features, random = body(5)
    defined = features.chain.home + 0.3
    steps = 0.01 * random.normal(size=(4, 21)), 0.02 * random.normal(size=4)
    errors = PlaceErrors(features, PIXEL, defined, DEPTH, SurfacePlace(LINK, 1.8, steps), LINK)
    np.testing.assert_allclose(errors(defined[None]), 0.0, atol=1e-9)
    other = defined + np.array([0, 0, 0, 0, 0.5])  # a joint that does not move it
    np.testing.assert_allclose(errors(other[None]), 0.0, atol=1e-9)


@pytest.mark.parametrize("surface", [None, SurfacePlace(LINK, 1.8)])
def test_of_a_model_that_knows_no_errors_the_depth_s_is_left(surface):
    features, _ = body(6)
    errors = PlaceErrors(features, PIXEL, features.chain.home, DEPTH, surface, LINK)(features.chain.home[None] + 0.3)
    assert errors.shape == (1, 1, 2)
    assert np.abs(errors).max() > 0.1


def test_behind_the_camera_nothing_is_known():
    chain = Chain(np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 0.2]]), np.zeros(1), np.array([-1]))
    features = BodyFeatures(chain, FOCAL, CENTER, np.array([True]))
    errors = PlaceErrors(features, PIXEL, np.zeros(1), DEPTH, None, 0)
    assert np.isfinite(errors(np.linspace(0, np.pi, 9)[:, None])).all()
    errors = PlaceErrors(features, CENTER, np.zeros(1), PointDepth(1e-4, 0.01), None, 0)
    assert (np.abs(errors(np.zeros((1, 1)))) == UNSEEN).all()
