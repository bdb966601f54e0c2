"""Features followed back through images that are far apart, with and without a body that says where to look."""

import cv2
import numpy as np
import pytest

from dense_vs.point_servo.look_back import _apart, _nearest_first, followed_back

STEP = np.array([26.0, 9.0])  # px a radian, by which everything moves


def history(count=5):
    """Fine texture before a camera that one joint shifts."""
    rng = np.random.default_rng(2)
    wide = cv2.GaussianBlur(rng.uniform(0, 255, (400, 600)), (0, 0), 1.2)
    wide = np.clip((wide - wide.mean()) * 3 + 128, 0, 255).astype(np.uint8)
    return [(np.ascontiguousarray(wide[100 - 9 * k : 300 - 9 * k, 200 - 26 * k : 460 - 26 * k]), np.array([float(k)]))
            for k in range(count)]  # fmt: skip


BEGUN = np.stack(np.meshgrid([170.0, 190.0, 210.0], [90.0, 110.0, 130.0]), axis=-1).reshape(-1, 2)


def trace(places, q_seen, q):
    return places + STEP * (q - q_seen)


def test_a_body_says_where_to_look():
    numbers = np.arange(7, 16)
    frames = followed_back(history(), numbers, BEGUN, trace)
    assert [frame.positions.tolist() for frame in frames] == [[0.0], [1.0], [2.0], [3.0], [4.0]]
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.features, numbers)
        np.testing.assert_allclose(frame.places, BEGUN + STEP * (k - 4), atol=0.1)
    np.testing.assert_array_equal(frames[-1].places, BEGUN)


@pytest.mark.parametrize("known", [False, True])
def test_what_it_does_not_know_is_looked_for_where_it_was(known):
    """By 26 px nothing is found so, or something else; a trace that is off by a few is enough."""

    def some(places, q_seen, q):
        there = trace(places, q_seen, q) + 3.0 * (q != q_seen)
        return there if known else np.full_like(there, np.nan)

    first = followed_back(history(), np.arange(9), BEGUN, some)[0]
    off = np.linalg.norm(first.places - (BEGUN[first.features] - 4 * STEP), axis=1)
    right = int((off < 0.5).sum())
    assert right == (9 if known else 0)


def test_without_a_body_slow_features_are_found():
    images = history()
    slow = [(image, q) for image, q in ((images[0][0], np.array([0.0])), (np.roll(images[0][0], 2, axis=1), [1.0]))]
    frames = followed_back(slow, np.arange(9), BEGUN)
    np.testing.assert_allclose(frames[0].places, BEGUN - [2.0, 0.0], atol=0.1)
    assert followed_back(slow[:1], np.arange(9), BEGUN)[0].places is not None


def test_images_are_reached_from_the_nearest_that_was_reached_before():
    at = np.array([0.0, 10.0, 11.0, 1.0, 5.0])
    assert [*_nearest_first(np.abs(at[:, None] - at), 4)] == [(4, 3), (3, 0), (4, 1), (1, 2)]
    assert [*_nearest_first(np.zeros((1, 1)), 0)] == []


def test_images_are_as_far_apart_as_most_of_their_places_or_else_as_their_joints():
    """75 of 100 places are nearer; places that are not known in some image say nothing."""
    postures = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 1.0]])
    expected = np.zeros((3, 5, 2))
    expected[1, :, 0], expected[2, :, 1] = [1.0, 2.0, 3.0, 4.0, 90.0], 2.0
    expected[2, 4] = np.nan
    one_three = np.quantile(np.hypot([1.0, 2.0, 3.0, 4.0], 2.0), 0.75)
    wanted = np.array([[0, 3.25, 2.0], [3.25, 0, one_three], [2.0, one_three, 0]])
    np.testing.assert_allclose(_apart(expected, postures), wanted)
    by_joints = np.array([[0, 5, 1], [5, 0, np.sqrt(18)], [1, np.sqrt(18), 0]])
    for nothing in (np.zeros((3, 5, 2)), np.full((3, 5, 2), np.nan)):  # no body, or one that does not know them
        np.testing.assert_allclose(_apart(nothing, postures), by_joints)


def test_an_image_is_followed_to_though_it_was_taken_long_before_the_last():
    """In order of time the last step would be 104 px: more than a body that is 20 % off leaves to be found."""
    images = history()
    shuffled = [images[k] for k in (3, 2, 1, 0, 4)]

    def rough(places, q_seen, q):
        return places + 0.8 * STEP * (q - q_seen)

    frames = followed_back(shuffled, np.arange(9), BEGUN, rough)
    for frame in frames:
        assert len(frame.features) == 9
        np.testing.assert_allclose(frame.places, BEGUN + STEP * (frame.positions - 4), atol=0.1)


def test_images_are_apart_by_what_moves_in_them_though_it_moves_along_a_line():
    """By the places that are known in all images; by the joints where none of these moves."""
    expected = np.full((3, 4, 2), 50.0)
    expected[:, :3, 0] = np.array([[0.0], [8.0], [10.0]])
    expected[1, 3] = np.nan
    postures = np.array([[0.0], [1.0], [0.1]])
    np.testing.assert_allclose(_apart(expected, postures), [[0, 8, 10], [8, 0, 2], [10, 2, 0]])
    by_joints = [[0, 1, 0.1], [1, 0, 0.9], [0.1, 0.9, 0]]
    np.testing.assert_allclose(_apart(np.full((3, 4, 2), 50.0), postures), by_joints)
    np.testing.assert_allclose(_apart(np.full((3, 4, 2), np.nan), postures), by_joints)
