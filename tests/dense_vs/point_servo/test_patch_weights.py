"""Which pixels a patch is followed by: those that move as its point does, less what is labeled as something else."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs import DenseJacobian
from dense_vs.point_servo.same_surface import patch_weights, same_surface

HEIGHT, WIDTH, WINDOW = 40, 60, 9
POINT = np.array([30.0, 20.0])


@pytest.fixture
def estimator():
    """J of a body that reaches from column 20 to 50, and smears over an edge at column 28 where another part begins."""
    known = np.zeros((HEIGHT, WIDTH, 2, 2), np.float32)
    known[:, 20:50] = [[80.0, 10.0], [0.0, 40.0]]
    one = DenseJacobian(height=HEIGHT, width=WIDTH, joints=2, order=1, device="cpu", threads=1)
    one.blend(known, np.ones((HEIGHT, WIDTH), np.float32))
    return one


def pipeline(estimator, labels):
    body = None if labels is None else object()
    return SimpleNamespace(estimator=estimator, body=body, labels=lambda: labels)


def test_without_labels_it_is_what_moves_as_the_point_does(estimator):
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[:, 20:50] = True
    np.testing.assert_array_equal(patch_weights(pipeline(estimator, None), POINT, WINDOW), expected)
    np.testing.assert_array_equal(same_surface(estimator, POINT), expected)


def test_what_stands_in_front_is_left_out(estimator):
    labels = np.zeros((HEIGHT, WIDTH), bool)
    labels[:, 28:58] = True
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[:, 28:50] = True
    np.testing.assert_array_equal(patch_weights(pipeline(estimator, labels), POINT, WINDOW), expected)


@pytest.mark.parametrize(("labeled", "taken"), [(12, False), (13, True)])
@pytest.mark.parametrize("corner", [(16, 26), (20, 30)])  # top left of the patch, and its middle
def test_labels_that_hardly_know_the_patch_say_nothing(estimator, labeled, taken, corner):
    """0.15 of 9 x 9 pixels are 12.15; what is labeled beside the patch does not count."""
    labels = np.zeros((HEIGHT, WIDTH), bool)
    top, left = corner
    for k in range(labeled):
        labels[top + k // 5, left + k % 5] = True
    labels[:15] = labels[25:] = True
    found = patch_weights(pipeline(estimator, labels), POINT, WINDOW)
    same = same_surface(estimator, POINT)
    np.testing.assert_array_equal(found, same & labels if taken else same)


def test_at_the_image_s_corner_the_patch_is_what_is_inside(estimator):
    labels = np.zeros((HEIGHT, WIDTH), bool)
    labels[:4, 20:24] = True
    found = patch_weights(pipeline(estimator, labels), np.array([20.0, 0.0]), WINDOW)
    np.testing.assert_array_equal(found, labels)


def test_where_j_says_nothing_there_are_no_weights():
    blank = DenseJacobian(height=HEIGHT, width=WIDTH, joints=2, order=1, device="cpu", threads=1)
    assert patch_weights(pipeline(blank, np.ones((HEIGHT, WIDTH), bool)), POINT, WINDOW) is None
