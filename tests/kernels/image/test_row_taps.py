"""Taps that a row's pixels find a block at once are those that each finds for itself, to the last bit."""

import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.image.bilinear import Taps, bilinear_taps
from dense_vs.kernels.image.row_taps import BLOCK_TAPS
from dense_vs.kernels.jacobian.moved_pixels import pixel_shift

HEIGHT, WIDTH = 13, 137  # two whole blocks and a part of one


_WRITE_ROW = f"""
    const int width = image.shape[2], height = image.shape[1];
    {BLOCK_TAPS}
    const Pair *shifts = reinterpret_cast<const Pair*>(image.data + (size_t)width * height);
    Taps taps;
    for (int first = 0; first < width; first += block) {{
        const int count = width - first < block ? width - first : block;
        moved_taps(taps, shifts, iterations, first, count);
        for (int k = 0; k < count; ++k)
            for (int corner = 0; corner < 4; ++corner) {{
                const size_t at = 4 * ((size_t)y * width + first + k) + corner;
                places.data[at] = taps.place[corner][k];
                weights.data[at] = taps.weight[corner][k];
            }}
    }}
"""


@wp.func_native(_WRITE_ROW)
def write_row(
    image: wp.array3d(dtype=wp.vec2),
    iterations: int,
    y: int,
    places: wp.array3d(dtype=int),
    weights: wp.array3d(dtype=float),
): ...


@wp.func
def write_pixel(
    taps: Taps, width: int, x: int, y: int, places: wp.array3d(dtype=int), weights: wp.array3d(dtype=float)
):
    places[y, x, 0] = taps.top * width + taps.left
    places[y, x, 1] = taps.top * width + taps.right
    places[y, x, 2] = taps.bottom * width + taps.left
    places[y, x, 3] = taps.bottom * width + taps.right
    weights[y, x, 0] = taps.upper_left
    weights[y, x, 1] = taps.upper_right
    weights[y, x, 2] = taps.lower_left
    weights[y, x, 3] = taps.lower_right


@wp.kernel
def both_ways(
    image: wp.array3d(dtype=wp.vec2),
    iterations: int,
    by_row: wp.array3d(dtype=int),
    by_row_weights: wp.array3d(dtype=float),
    by_pixel: wp.array3d(dtype=int),
    by_pixel_weights: wp.array3d(dtype=float),
):
    y = wp.tid()
    width = image.shape[2]
    height = image.shape[1]
    write_row(image, iterations, y, by_row, by_row_weights)
    for x in range(width):
        moved = pixel_shift(image, 1, x, y, iterations, width, height)
        write_pixel(bilinear_taps(x, y, moved, width, height), width, x, y, by_pixel, by_pixel_weights)


@pytest.mark.parametrize("iterations", [0, 1, 2, 3])
@pytest.mark.parametrize("size", [0.3, 4.0, 300.0])
def test_same_bits(iterations, size):
    rng = np.random.default_rng(iterations)
    image = rng.normal(0, size, (2, HEIGHT, WIDTH, 2)).astype(np.float32)
    image[1, 3, 5:9] = [np.nan, 1.0]
    image[1, 4, 5:9] = [1.0, -np.inf]
    if iterations > 1:  # what is sampled has to be numbers
        image[~np.isfinite(image)] = 0.0
    outs = [
        wp.full((HEIGHT, WIDTH, 4), value, dtype=dtype, device="cpu")
        for dtype, value in ((int, -9), (float, np.nan)) * 2
    ]
    inputs = [wp.array(image, dtype=wp.vec2, device="cpu"), iterations]
    wp.launch(both_ways, dim=HEIGHT, inputs=[*inputs, *outs], device="cpu")
    by_row, by_row_weights, by_pixel, by_pixel_weights = (out.numpy() for out in outs)
    np.testing.assert_array_equal(by_row, by_pixel)
    np.testing.assert_array_equal(by_row_weights, by_pixel_weights)
    assert by_row.min() >= 0
    assert by_row.max() == HEIGHT * WIDTH - 1
    np.testing.assert_allclose(by_row_weights.sum(axis=2), 1.0, atol=1e-6)
