"""Sums over a patch's pixels, 8 at a time, against the same sums in float64, pixel by pixel."""

import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.image.pixel_runs import run_module
from dense_vs.kernels.tracking.patch_sums import is_well_inside, patch_sums_on_cpu

HEIGHT, WIDTH = 48, 64


@wp.kernel(module=run_module(f"{__name__}_sums"), enable_backward=False)
def sums_of(
    image: wp.array3d(dtype=wp.uint8),
    pixels: wp.array3d(dtype=wp.vec2),
    window: int,
    base_x: int,
    base_y: int,
    p: wp.vec2,
    affine: wp.mat22,
    sums_out: wp.array(dtype=float),
    products_out: wp.array2d(dtype=float),
    hidden_out: wp.array(dtype=float),
    inside_out: wp.array(dtype=int),
):
    sums, products, hidden = patch_sums_on_cpu(image, pixels, 1, 1, window, base_x, base_y, p, affine)
    for k in range(24):
        sums_out[k] = sums[k]
    for i in range(6):
        for j in range(6):
            products_out[i, j] = products[i, j]
    hidden_out[0] = hidden
    inside_out[0] = int(is_well_inside(image, window, base_x, base_y, p, affine))


def spline(a):
    """Cubic B-spline's weights at the pixels -1, 0, 1, 2, and their derivatives."""
    b = 1 - a
    weights = np.array([b**3, 3 * a**3 - 6 * a**2 + 4, 3 * b**3 - 6 * b**2 + 4, a**3]) / 6
    return weights, np.array([-(b**2), 3 * a**2 - 4 * a, 4 * b - 3 * b**2, a**2]) / 2


def reference(image, pixels, window, at, affine):
    """The sums, products and weight outside by their definition; gray values count from that of the patch's middle."""
    sums, products, hidden, half = np.zeros(24), np.zeros((6, 6)), 0.0, window // 2
    middle = float(pixels[window**2 // 2, 0])
    for k, (shown, w) in enumerate(pixels.astype(float)):
        offset = np.array([k % window - half, k // window - half], float)
        place = at + affine @ offset
        if not ((place >= 0).all() and (place <= (WIDTH - 1, HEIGHT - 1)).all()):
            hidden += w
            continue
        left, top = np.floor(place).astype(int)
        (across, along), (down, downward) = spline(place[0] - left), spline(place[1] - top)
        taps = np.arange(-1, 3)
        rows, columns = np.clip(top + taps, 0, HEIGHT - 1), np.clip(left + taps, 0, WIDTH - 1)
        gray = image[np.ix_(rows, columns)].astype(float)
        i, t = down @ gray @ across - 128 - middle, shown - middle
        gx, gy = affine.T @ [down @ gray @ along, downward @ gray @ across]
        x, y = offset / half
        g = np.array([gx * x, gy * x, gx * y, gy * y, gx, gy])
        sums += w * np.concatenate([[1, i, t, i * i, t * t, i * t], g, g * i, g * t])
        products += w * np.outer(g, g)
    return sums, products, hidden


@pytest.mark.parametrize("window", [3, 5, 7, 9, 15, 25])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("at", "inside"), [((31.3, 23.8), True), ((20.0, 22.0), True), ((6.2, 45.5), False), ((-2.5, 23.0), False)]
)
def test_sums_are_those_of_every_pixel(window, turned, at, inside):
    rng = np.random.default_rng(window)
    images = rng.integers(0, 256, (2, HEIGHT, WIDTH), np.uint8)
    pixels = np.zeros((2, 2, window**2, 2), np.float32)
    pixels[..., 0], pixels[..., 1] = rng.normal(0, 40, pixels.shape[:-1]), rng.uniform(0, 1, pixels.shape[:-1])
    pixels[..., 1] *= rng.uniform(0, 1, pixels.shape[:-1]) > 0.2
    affine = np.array([[0.8, -0.35], [0.3, 0.9]]) if turned else np.eye(2)
    base = np.floor(at).astype(int)
    out = wp.zeros(24, dtype=float), wp.zeros((6, 6), dtype=float), wp.zeros(1, dtype=float), wp.zeros(1, dtype=int)
    out = [wp.clone(one, device="cpu") for one in out]
    inputs = [
        wp.array(images, device="cpu"), wp.array(pixels, dtype=wp.vec2, device="cpu"), window, *map(int, base),
        wp.vec2(*(np.array(at) - base)), wp.mat22(*affine.ravel()),
    ]  # fmt: skip
    wp.launch(sums_of, 1, inputs=inputs, outputs=out, device="cpu")
    sums, products, hidden, found_inside = (one.numpy() for one in out)
    expected, expected_products, expected_hidden = reference(images[1], pixels[1, 1], window, np.array(at), affine)
    if window <= 15:  # larger ones reach over the border from everywhere but the middle
        assert bool(found_inside[0]) is inside
    size = np.abs(expected).max()
    np.testing.assert_allclose(sums, expected, rtol=1e-4, atol=2e-6 * size)
    np.testing.assert_allclose(products, expected_products, rtol=1e-4, atol=2e-6 * np.abs(expected_products).max())
    assert hidden[0] == pytest.approx(expected_hidden, abs=1e-4)


def test_what_reaches_over_the_border_is_summed_up_pixel_by_pixel():
    """3 px more than the patch have to be inside: what its samples draw on."""
    image = wp.zeros((1, HEIGHT, WIDTH), dtype=wp.uint8, device="cpu")

    @wp.kernel(module=run_module(f"{__name__}_inside"), enable_backward=False)
    def inside_of(image: wp.array3d(dtype=wp.uint8), at: wp.array(dtype=wp.vec2), out: wp.array(dtype=int)):
        k = wp.tid()
        out[k] = int(is_well_inside(image, 15, 0, 0, at[k], wp.mat22(1.0, 0.0, 0.0, 1.0)))

    last = WIDTH - 1.0, HEIGHT - 1.0
    at = [[10, 24], [9.9, 24], [24, 9.9], [last[0] - 10, 24], [last[0] - 9.9, 24], [24, last[1] - 9.9], [np.nan, 24]]
    out = wp.zeros(len(at), dtype=int, device="cpu")
    wp.launch(inside_of, len(at), [image, wp.array(at, dtype=wp.vec2, device="cpu"), out], device="cpu")
    assert out.numpy().tolist() == [1, 0, 0, 1, 0, 0, 0]
