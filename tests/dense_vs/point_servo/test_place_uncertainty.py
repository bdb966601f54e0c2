"""How well a place is known, by hand."""

import numpy as np
import pytest

from dense_vs.point_servo.place_uncertainty import OwnLook, few, place_uncertainty, untied

BY_DEPTH, OFFSET = np.array([0.6, -0.8]), np.array([0.9, -1.2])  # px: 1 and 1.5
FEATURES = (0.5 * 1.5) ** 2 + (1.5 / 3) ** 2  # half the offset, and three features
ALONE = (0.5 * 1.5) ** 2 + (5 / 3) ** 2  # the same where its look does not confirm them
UNSEEN = OwnLook()


def known(held=True, told=3, look=UNSEEN, by_depth=BY_DEPTH):
    return place_uncertainty(by_depth, OFFSET, held, told, 0.7, look)


def test_beside_features_of_its_own_image():
    like = OwnLook(0.8)  # not enough to be a witness
    assert known(look=like) == pytest.approx(np.sqrt(0.8**2 + FEATURES + 0.7**2))
    assert known(look=like, by_depth=2 * BY_DEPTH) == pytest.approx(np.sqrt(1.6**2 + FEATURES + 0.7**2))
    assert known(look=like, told=6) == pytest.approx(np.sqrt(0.8**2 + 0.75**2 + 0.25**2 + 0.7**2))
    assert known(look=like, told=0) == pytest.approx(np.sqrt(0.8**2 + 0.75**2 + 1.5**2 + 0.7**2))


@pytest.mark.parametrize(
    ("correlation", "times"), [(-1.0, 5.0), (0.0, 5.0), (0.5, 5.0), (0.56, 4.3), (0.65, 3.25), (0.8, 1.5), (0.99, 1.5)]
)
def test_few_features_tell_less_where_the_look_does_not_confirm_them(correlation, times):
    assert few(correlation) == pytest.approx(times)
    for told in (3, 6):
        expected = 0.8**2 + 0.75**2 + (times / told) ** 2 + 0.7**2
        assert known(told=told, look=OwnLook(correlation)) == pytest.approx(np.sqrt(expected))


def test_a_look_that_is_seen_is_a_second_witness():
    assert known(look=OwnLook(0.9, 1e6)) == pytest.approx(np.sqrt(0.5**2 + FEATURES + 0.7**2))
    both = 1 / (1 / (0.5**2 + FEATURES + 0.7**2) + 1 / 0.5**2)  # each with its own error
    assert known(look=OwnLook(0.9, 0.5)) == pytest.approx(np.sqrt(both))
    assert known(look=OwnLook(0.9, 0.5, 2.0)) == pytest.approx(np.sqrt(both + 2.0**2))  # they disagree


@pytest.mark.parametrize(
    ("correlation", "off"),
    [(-1.0, 1.2), (0.5, 1.2), (0.8, 1.2), (0.83, 0.96), (0.875, 0.6), (0.905, 0.36), (0.95, 0.36), (1.0, 0.36)],
)
def test_a_place_that_is_not_tied_to_its_own_image_is_known_less_the_less_it_looks_like_it(correlation, off):
    assert untied(correlation) == pytest.approx(off)
    look = OwnLook(correlation)
    features = ALONE if correlation <= 0.5 else FEATURES
    assert known(held=False, look=look) == pytest.approx(np.sqrt(1.2**2 + features + off**2 + 0.7**2))


def test_its_look_is_a_witness_of_what_is_not_tied_too():
    link = 1.2**2 + FEATURES + 0.36**2 + 0.7**2
    both = 1 / (1 / link + 1 / 0.5**2)
    assert known(held=False, look=OwnLook(0.96, 0.5)) == pytest.approx(np.sqrt(both))
