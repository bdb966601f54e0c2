"""Colours of vectors against OpenCV's, which rounds hues to two degrees."""

import cv2
import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.image.vector_colors import vector_colours_kernel
from dense_vs.kernels.launch import launch_pixels
from dense_vs.view.panels import vectors_to_rgb

HUE_STEP = 255 / 60 * 2  # grey levels that two degrees of hue make


def opencv(vectors, full_scale):
    length, angle = cv2.cartToPolar(vectors[..., 0], vectors[..., 1], angleInDegrees=True)
    hsv = np.full((*vectors.shape[:2], 3), 255, dtype=np.uint8)
    hsv[..., 0] = angle / 2
    hsv[..., 2] = np.clip(np.rint(length * (255 / full_scale)), 0, 255)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)


@pytest.mark.parametrize("seed", range(3))
def test_as_opencv(seed):
    vectors = np.random.default_rng(seed).normal(0, 2, (31, 47, 2)).astype(np.float32)
    difference = np.abs(vectors_to_rgb(vectors, 3.0).astype(int) - opencv(vectors, 3.0))
    assert difference.max() <= HUE_STEP + 2


def test_the_four_directions_and_what_is_no_vector():
    vectors = np.array([[[1, 0], [0, 1], [-1, 0], [0, -1]], [[0, 0], [np.nan, 1], [np.inf, 0], [9, 0]]], np.float32)
    expected = [[[255, 0, 0], [128, 255, 0], [0, 255, 255], [128, 0, 255]], [[0, 0, 0]] * 3 + [[255, 0, 0]]]
    assert np.abs(vectors_to_rgb(vectors, 1.0).astype(int) - expected).max() <= 1


def test_any_number_of_threads_and_worlds():
    vectors = np.random.default_rng(0).normal(0, 2, (2, 9, 7, 2)).astype(np.float32)
    outs = []
    for threads in (1, 3):
        out = wp.zeros((2, 9, 7), dtype=wp.vec3ub, device="cpu")
        arguments = [wp.array(vectors, dtype=wp.vec2, device="cpu"), 3.0, out]
        launch_pixels(vector_colours_kernel, (2, 9, 7), arguments, "cpu", threads)
        outs.append(out.numpy())
    np.testing.assert_array_equal(outs[0], outs[1])
    np.testing.assert_array_equal(outs[0][1], vectors_to_rgb(vectors[1], 3.0))
