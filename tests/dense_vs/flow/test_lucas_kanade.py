"""Flow where there is little to see: it equals the least squares of the window, whatever the exposure does."""

import numpy as np
import pytest
from reference_lucas_kanade import lucas_kanade
from scipy.ndimage import gaussian_filter, shift

from dense_vs import FlowEstimator
from dense_vs.flow import lucas_kanade as method
from dense_vs.flow.lucas_kanade import LucasKanade

MOVED = np.array([0.8, -0.5])  # px, x and y
INNER = (slice(20, -20), slice(20, -20))


def picture(rng, contrast):
    """Smooth random texture (96, 128) with that standard deviation about middle gray."""
    texture = gaussian_filter(rng.normal(size=(96, 128)), 2.0, mode="wrap")
    return 128 + contrast * texture / texture.std()


def moved(image):
    return shift(image, MOVED[::-1], order=5, mode="grid-wrap")


def as_image(levels):
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def median_error(flow):
    return np.median(np.linalg.norm(flow - MOVED, axis=2)[INNER])


def test_faint_texture_is_enough():
    """A standard deviation of 3 of 255 gray levels, which rounding to whole levels spoils a little."""
    image = picture(np.random.default_rng(0), 3.0)
    assert median_error(LucasKanade()(as_image(image), as_image(moved(image)))) < 0.08


def test_a_plain_stripe_between_textured_ones_moves_with_them():
    image = picture(np.random.default_rng(3), 20.0)
    image[:, 56:72] = 128.0  # 16 px without any texture: nothing there to search for
    before, now = as_image(image), as_image(moved(image))
    plain = (slice(20, -20), slice(60, 68))
    error = np.linalg.norm(LucasKanade()(before, now) - MOVED, axis=2)[plain]
    searched = np.linalg.norm(FlowEstimator("dis", 96, 128)(before, now) - MOVED, axis=2)[plain]
    assert np.median(error) < 0.2
    assert np.median(error) < np.median(searched)


def test_flicker_is_no_motion():
    image = picture(np.random.default_rng(1), 12.0)
    brighter = as_image(1.05 * image)
    flow = LucasKanade()(as_image(image), brighter)
    assert np.median(np.linalg.norm(flow, axis=2)[INNER]) < 0.05
    assert median_error(LucasKanade()(as_image(image), as_image(1.05 * moved(image)))) < 0.08


def test_an_edge_says_nothing_about_motion_along_it():
    step = np.full((96, 128), 90.0)
    step[:, 64:] = 160.0
    before = as_image(gaussian_filter(step, 1.5))
    now = as_image(gaussian_filter(shift(step, (0, 1), order=0, mode="nearest"), 1.5))
    near = LucasKanade()(before, now)[20:-20, 62:68]
    np.testing.assert_allclose(near[..., 0], 1.0, atol=0.1)
    np.testing.assert_allclose(near[..., 1], 0.0, atol=0.02)


def test_a_blank_image_does_not_move():
    blank = np.full((64, 64), 77, np.uint8)
    np.testing.assert_array_equal(LucasKanade()(blank, blank), 0.0)
    noise = np.random.default_rng(2).integers(70, 84, (64, 64)).astype(np.uint8)
    assert np.isfinite(LucasKanade()(blank, noise)).all()


def pair(height, width, seed=4):
    """Two images of texture that turns a little and grows."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width].astype(float)
    waves = [(rng.normal(0, 0.25, 2), rng.uniform(0, 6), rng.uniform(5, 20)) for _ in range(12)]

    def look(x, y):
        return as_image(128 + sum(size * np.sin(k[0] * x + k[1] * y + phase) for k, phase, size in waves))

    dx, dy = 0.02 * (x - width / 2) + 0.9, 0.03 * (y - height / 2) - 0.6
    return look(x, y), look(x - dx, y - dy)


@pytest.mark.parametrize("size", [(16, 16), (19, 43), (61, 64), (97, 131), (130, 270)])
def test_follows_the_equations(size):
    before, now = pair(*size)
    expected = lucas_kanade(before, now, method)
    assert np.abs(expected).max() > 0.5
    np.testing.assert_allclose(LucasKanade()(before, now), expected, atol=2e-3)


def test_threads_and_what_is_kept_change_no_bit():
    before, now = pair(121, 190)
    _, other = pair(121, 190, seed=5)
    one, three = LucasKanade(1), LucasKanade(3)
    expected = one(before, now)
    np.testing.assert_array_equal(three(before, now), expected)
    later = three(now, other)  # ``now`` is known already
    np.testing.assert_array_equal(later, LucasKanade(2)(now, other))
    np.testing.assert_array_equal(three(before, now), expected)  # another previous image than the one kept
    assert np.abs(later - expected).max() > 0.1


def test_an_image_that_is_written_over_is_another_image():
    before, now = pair(64, 80)
    flow = LucasKanade()
    moved_once = flow(before, now)
    now[...] = before
    np.testing.assert_array_equal(flow(now, before), 0.0)
    assert np.abs(moved_once).max() > 0.5
