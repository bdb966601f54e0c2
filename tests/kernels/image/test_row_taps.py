"""Taps of a row found at once are those that each pixel finds for itself, to the last bit."""

import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.image.bilinear import Taps, bilinear_taps
from dense_vs.kernels.image.row_taps import RowTaps, find_row_taps, row_taps
from dense_vs.kernels.jacobian.image_jacobian import displacement

HEIGHT, WIDTH = 13, 37


@wp.func
def write_taps(taps: Taps, x: int, y: int, places: wp.array3d(dtype=int), weights: wp.array3d(dtype=float)):
    places[y, x, 0] = taps.left
    places[y, x, 1] = taps.top
    places[y, x, 2] = taps.right
    places[y, x, 3] = taps.bottom
    weights[y, x, 0] = taps.upper_left
    weights[y, x, 1] = taps.upper_right
    weights[y, x, 2] = taps.lower_left
    weights[y, x, 3] = taps.lower_right


@wp.kernel
def both_ways(
    image: wp.array3d(dtype=wp.vec2),
    iterations: int,
    row_places: wp.array3d(dtype=int),
    row_fractions: wp.array3d(dtype=float),
    by_row: wp.array3d(dtype=int),
    by_row_weights: wp.array3d(dtype=float),
    by_pixel: wp.array3d(dtype=int),
    by_pixel_weights: wp.array3d(dtype=float),
):
    y = wp.tid()
    width = image.shape[2]
    height = image.shape[1]
    find_row_taps(image, 1, y, iterations, 2, row_places, row_fractions)
    for x in range(width):
        write_taps(row_taps(2, x, row_places, row_fractions), x, y, by_row, by_row_weights)
        moved = displacement(image, 1, x, y, iterations, width, height)
        write_taps(bilinear_taps(x, y, moved, width, height), x, y, by_pixel, by_pixel_weights)


@pytest.mark.parametrize("iterations", [0, 1, 2, 3])
@pytest.mark.parametrize("size", [0.3, 4.0, 300.0])
def test_same_bits(iterations, size):
    rng = np.random.default_rng(iterations)
    image = rng.normal(0, size, (2, HEIGHT, WIDTH, 2)).astype(np.float32)
    image[1, 3, 5:9] = [np.nan, 1.0]
    image[1, 4, 5:9] = [1.0, -np.inf]
    if iterations > 1:  # what is sampled has to be numbers
        image[~np.isfinite(image)] = 0.0
    room = RowTaps.empty(HEIGHT, WIDTH, "cpu")
    outs = [
        wp.full((HEIGHT, WIDTH, 4), value, dtype=dtype, device="cpu")
        for dtype, value in ((int, -9), (float, np.nan)) * 2
    ]
    inputs = [wp.array(image, dtype=wp.vec2, device="cpu"), iterations, *room.arrays]
    wp.launch(both_ways, dim=HEIGHT, inputs=[*inputs, *outs], device="cpu")
    by_row, by_row_weights, by_pixel, by_pixel_weights = (out.numpy() for out in outs)
    np.testing.assert_array_equal(by_row, by_pixel)
    np.testing.assert_array_equal(by_row_weights, by_pixel_weights)
    assert by_row.min() >= 0
    assert by_row[..., 0::2].max() == WIDTH - 1
    np.testing.assert_allclose(by_row_weights.sum(axis=2), 1.0, atol=1e-6)
