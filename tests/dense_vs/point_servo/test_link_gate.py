"""Features that are not where the others of their link are."""

import numpy as np

from dense_vs.point_servo.link_gate import off_their_link


def test_those_more_than_two_px_from_the_median_of_their_link_in_directions_that_tell():
    off = np.array([[1, 1], [1.5, 1], [1, 1], [1, 3.1], [2.9, 1], [9, 9], [-9, 0], [30, 0], [0, 0]], float)
    links = np.array([0, 0, 0, 0, 0, 1, 1, 0, 0])
    counted = np.array([True] * 7 + [False, True])
    directions = np.tile(np.eye(2), (9, 1, 1))
    expected = [False, False, False, True, False, False, False, False, False]  # two of a link are too few to tell
    np.testing.assert_array_equal(off_their_link(off, directions, links, counted), expected)
    directions[3] = np.diag([1.0, 0.1])  # along an edge nothing is seen
    assert not off_their_link(off, directions, links, counted).any()
    directions[4] = np.diag([1.2, 1.0])
    assert off_their_link(off, directions, links, counted).tolist() == [False] * 4 + [True] + [False] * 4


def test_three_of_a_link_are_enough_to_tell():
    off, everything = np.array([[0, 0], [0, 0], [3, 0]], float), np.ones(3, bool)
    found = off_their_link(off, np.tile(np.eye(2), (3, 1, 1)), np.zeros(3, int), everything)
    assert found.tolist() == [False, False, True]


def test_without_features_there_are_none():
    nothing = np.zeros(0, bool)
    assert off_their_link(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, int), nothing).shape == (0,)
