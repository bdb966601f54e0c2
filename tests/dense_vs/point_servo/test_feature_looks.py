"""Features held to their first looks, on images that are moved, turned and covered by known amounts."""

import cv2
import numpy as np
import pytest

from dense_vs.point_servo.feature_looks import FeatureLooks

CENTER = np.array([80.0, 60.0])


def texture(seed=0):
    noise = np.random.default_rng(seed).uniform(0, 255, (120, 160)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(blurred, np.empty_like(blurred), 0, 255, cv2.NORM_MINMAX)


def seen(degrees, shift, seed=0):
    """The texture turned about its middle and then shifted, as uint8, and where a place is then."""
    turn = cv2.getRotationMatrix2D(CENTER.tolist(), degrees, 1.0)
    turn[:, 2] += shift
    return cv2.warpAffine(texture(seed), turn, (160, 120), flags=cv2.INTER_CUBIC).astype(np.uint8), turn


def moved(places, turn):
    return places @ turn[:, :2].T + turn[:, 2]


PLACES = np.array([[70.0, 50.0], [90.0, 52.0], [82.0, 75.0]])


def begun():
    looks = FeatureLooks()
    looks.take(np.arange(3), seen(0.0, (0, 0))[0], PLACES)
    return looks


@pytest.mark.parametrize("drift", [0.0, 0.7, 1.4])
def test_a_place_that_has_drifted_is_corrected(drift):
    image, turn = seen(4.0, (1.3, -0.6))
    true = moved(PLACES, turn)
    places, sure, alike = begun().held(np.arange(3), image, true + np.array([drift, -drift]))
    assert sure.all()
    assert alike.all()
    np.testing.assert_allclose(places, true, atol=0.1)


def test_looks_turn_on_with_the_features():
    looks = begun()
    for degrees in range(0, 91, 6):  # by far more than a look is found at from one image
        image, turn = seen(float(degrees), (0.0, 0.0))
        true = moved(PLACES, turn)
        places, sure, _ = looks.held(np.arange(3), image, true + 0.5)
        assert sure.all()
        np.testing.assert_allclose(places, true, atol=0.15)
    back, _ = seen(0.0, (0, 0))
    assert not looks.held(np.arange(3), back, PLACES)[1].any()
    looks.unturned(np.array([0, 2]))
    assert looks.held(np.arange(3), back, PLACES)[1].tolist() == [True, False, True]


def test_what_looks_otherwise_is_neither_sure_nor_alike():
    image, _ = seen(0.0, (0, 0))
    image[:, 85:] = seen(0.0, (0, 0), seed=5)[0][:, 85:]  # something else covers the second
    guess = PLACES + np.array([[0.2, 0.0], [0.2, 0.0], [-6.0, 5.0]])  # and the third is elsewhere
    places, sure, alike = begun().held(np.arange(3), image, guess)
    assert sure.tolist() == [True, False, False]
    assert not alike[1]
    np.testing.assert_allclose(places[0], PLACES[0], atol=0.05)
    np.testing.assert_array_equal(places[1:], guess[1:])


def test_numbers_are_those_of_the_features():
    image, _ = seen(0.0, (0, 0))
    looks = begun()
    looks.take(np.array([3]), image, np.array([[60.0, 40.0]]))
    guess = np.array([[60.4, 40.3], [70.4, 50.3]])
    places, sure, _ = looks.held(np.array([3, 0]), image, guess)
    assert sure.all()
    np.testing.assert_allclose(places, [[60, 40], [70, 50]], atol=0.05)
    looks.renumber(np.array([-1, 0, -1, 1]))
    places, sure, _ = looks.held(np.array([1, 0]), image, np.array([[60.4, 40.3], [90.4, 52.3]]))
    assert sure.all()
    np.testing.assert_allclose(places, [[60, 40], [90, 52]], atol=0.05)
    nobody = looks.held(np.zeros(0, int), image, np.zeros((0, 2)))
    assert [len(one) for one in nobody] == [0, 0, 0]
    looks.take(np.zeros(0, int), image, np.zeros((0, 2)))


def test_looks_are_sought_turned_as_told_and_followed_on_from_there():
    image, turn = seen(70.0, (1.5, -1.0))
    true = moved(PLACES, turn)
    maps = np.tile(turn[:, :2], (3, 1, 1))
    looks = begun()
    assert not looks.held(np.arange(3), image, true)[1].any()  # turned too far for what it looked like
    places, sure = looks.sought(np.arange(3), image, true + 1.5, maps, 3.0)
    assert sure.all()
    np.testing.assert_allclose(places, true, atol=0.15)
    assert looks.held(np.arange(3), image, true)[1].all()  # and now it is known how it is turned
    places, sure = looks.sought(np.zeros(0, int), image, np.zeros((0, 2)), np.zeros((0, 2, 2)), 3.0)
    assert places.shape == (0, 2)
    assert sure.shape == (0,)


@pytest.mark.parametrize(("seed", "most_off", "found"), [(0, 2.2, True), (1, 2.2, False), (0, 2.0, False)])
def test_a_sought_look_has_to_be_like_it_and_near(seed, most_off, found):
    image, _ = seen(0.0, (0.0, 0.0), seed)
    looks = begun()
    _, sure = looks.sought(np.arange(3), image, PLACES + 1.5, np.tile(np.eye(2), (3, 1, 1)), most_off)  # 2.1 px
    assert sure.tolist() == [found] * 3
