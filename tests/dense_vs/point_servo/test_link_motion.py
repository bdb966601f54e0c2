"""A link's motion fitted to places of points whose chain is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dense_vs.point_servo.link_motion import LinkMotion, first_guesses, refine, uncertainty

CENTER, FOCAL = np.array([159.5, 119.5]), 310.0
GUESS = 288.0


def turned(axis, place, angle, X):
    """X after a turn about the line, by SciPy."""
    return Rotation.from_rotvec(axis * angle).apply(X - place) + place


@pytest.fixture(scope="module")
def chain():
    """Three lines, a link's 12 points, and postures near q0 with the places of the points in them."""
    rng = np.random.default_rng(4)
    axes = np.array([[0.1, -0.9, -0.3], [0.5, 0.3, -0.8], [-0.2, -0.9, 0.4]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    places = np.array([[0.1, 0.3, 1.3], [0.2, 0.1, 1.2], [0.1, -0.1, 1.1]])
    points = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.07, 0.07, (12, 3))
    points /= points[0, 2]
    q0 = np.array([0.2, -0.4, 1.0])
    postures = q0 + rng.normal(0, 0.15, (60, 3))
    postures[0] = q0
    return axes, places, points, q0, postures


def seen(chain, postures):
    axes, places, points, q0, _ = chain
    result = []
    for q in postures:
        X = points
        for axis, place, angle in reversed(list(zip(axes, places, q - q0, strict=True))):
            X = turned(axis, place, angle, X)
        result.append(CENTER + FOCAL * X[:, :2] / X[:, 2:])
    return np.array(result)


def fitted(chain, noise):
    _, _, _, q0, postures = chain
    rng = np.random.default_rng(1)
    true = seen(chain, postures)
    places = true + noise * rng.standard_normal(true.shape)
    weights = np.ones(true.shape[:2])
    options = {"focal_guess": GUESS}
    guesses = first_guesses(postures, places, weights, q0, true[0], CENTER, GUESS)
    tried = [refine(guess, postures, places, weights, iterations=10, **options) for guess in guesses]
    motion, _ = refine(min(tried, key=lambda one: one[1])[0], postures, places, weights, iterations=40, **options)
    return motion, weights


def test_it_says_where_the_points_are(chain):
    axes, places, points, q0, postures = chain
    across = places - axes * np.sum(axes * places, axis=1, keepdims=True)
    motion = LinkMotion(q0, axes, across, FOCAL, CENTER, points)
    np.testing.assert_allclose(motion.project(postures), seen(chain, postures), atol=1e-9)


def test_the_chain_is_found_from_what_is_seen(chain):
    axes, _, _, q0, postures = chain
    motion, _ = fitted(chain, 0.0)
    far = q0 + 4 * (postures[1:20] - q0)
    np.testing.assert_allclose(motion.project(postures), seen(chain, postures), atol=0.05)
    np.testing.assert_allclose(motion.directions, axes, atol=0.05)
    error = np.linalg.norm(motion.project(far) - seen(chain, far), axis=2)
    assert np.median(error) < 0.5


def test_noise_costs_a_pixel_far_away_and_the_fit_says_so(chain):
    _, _, _, q0, postures = chain
    motion, weights = fitted(chain, 0.5)
    near, far = (q0 + factor * (postures[1:20] - q0) for factor in (1, 4))
    error = np.linalg.norm(motion.project(far) - seen(chain, far), axis=2)[:, 0]
    assert np.median(error) < 3.0
    options = {"focal_guess": GUESS, "scale": 0.5}
    said = [np.median([uncertainty(motion, postures, weights, q, **options) for q in asked]) for asked in (near, far)]
    assert said[0] < said[1]
    assert said[1] / 4 < np.median(error) < 4 * said[1]


def test_wrong_places_are_left_out(chain):
    _, _, _, q0, postures = chain
    true = seen(chain, postures)
    places, weights = true.copy(), np.ones(true.shape[:2])
    places[5:25, 3] += 20.0
    places[~np.isfinite(places)] = 0.0
    guesses = first_guesses(postures, places, weights, q0, true[0], CENTER, GUESS)
    tried = [refine(guess, postures, places, weights, iterations=15, focal_guess=GUESS) for guess in guesses]
    motion = min(tried, key=lambda one: one[1])[0]
    assert np.median(np.linalg.norm(motion.project(postures) - true, axis=2)) < 0.3
