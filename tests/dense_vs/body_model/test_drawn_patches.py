"""Patches of a drawn body: which are chosen, and where an image looks most like them, against sums written out."""

from types import SimpleNamespace

import numpy as np
import pytest
from textured_arm import SIZE, TexturedArm, postures

from dense_vs.body_model import drawn_patches
from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.drawn_patches import (
    APART,
    HALF,
    LEAST_SPREAD,
    PATCHES,
    WINDOW,
    DrawnBody,
    _patches,
    _peak,
    _sought,
    agreement,
    correlations,
    distinct_pixels,
    draw,
    seek,
    smooth,
)
from dense_vs.body_model.model import BodyImage

RNG = np.random.default_rng(4)


def texture(height=60, width=80):
    """Smooth random gray values."""
    return smooth(smooth(RNG.uniform(0, 255, (height, width))))


def drawn(gray, body=None):
    links = np.where(np.ones(gray.shape, bool) if body is None else body, 0, BACKGROUND)
    there = BodyImage(links, links, np.where(links == 0, 1.0, np.inf))
    return DrawnBody(np.where(links == 0, gray, 0).astype(np.float32), there)


def reference(patch, weights, around):
    """Weighted normalized cross-correlation in float64, written out."""
    patch, weights, around = (one.astype(np.float64) for one in (patch, weights, around))
    height, width = (a - b + 1 for a, b in zip(around.shape, patch.shape, strict=True))
    found = np.zeros((height, width))
    p = patch - (weights * patch).sum() / weights.sum()
    for v in range(height):
        for u in range(width):
            there = around[v : v + patch.shape[0], u : u + patch.shape[1]]
            t = there - (weights * there).sum() / weights.sum()
            found[v, u] = (weights * p * t).sum() / np.sqrt((weights * p * p).sum() * (weights * t * t).sum())
    return found


MIDDLE = np.array([[HALF, HALF]])


def correlation(patch, weights, around):
    """Of a patch that counts where weights are 1, wherever it lies in an image; None of a plain one."""
    one = _patches(drawn(patch, weights > 0), MIDDLE)
    return _sought(one, 0, around) if len(one.pixels) else None


def test_the_correlation_is_that_of_what_is_body():
    image = texture()
    weights = (RNG.random((WINDOW, WINDOW)) < 0.6).astype(np.float32)
    patch, around = image[10 : 10 + WINDOW, 20 : 20 + WINDOW].copy(), image[5:35, 12:50]
    patch[weights == 0] = 1e3  # what is behind does not matter
    found = correlation(patch, weights, around)
    np.testing.assert_allclose(found, reference(patch, weights, around), atol=2e-3)
    assert np.unravel_index(found.argmax(), found.shape) == (5, 8)
    dimmed = correlation(patch, weights, (0.5 * around + 30).astype(np.float32))
    np.testing.assert_allclose(dimmed, found, atol=5e-3)  # exposure does not matter


def test_what_is_plain_tells_nothing():
    image, ones = texture(), np.ones((WINDOW, WINDOW), np.float32)
    faint = (1.9 * np.sign(RNG.normal(size=(WINDOW, WINDOW))) + 90).astype(np.float32)  # deviates by less than 2
    assert correlation(faint, ones, image) is None
    assert correlation(1.2 * faint, ones, image) is not None
    assert not correlation(image[:WINDOW, :WINDOW], ones, np.full((30, 30), 90, np.float32)).any()


@pytest.mark.parametrize(("deviation", "counts"), [(1.3, False), (1.6, True)])  # gray levels; half of 2^2 is 1.41^2
def test_an_image_that_is_plain_there_looks_like_nothing(deviation, counts):
    patch, ones = texture()[:WINDOW, :WINDOW], np.ones((WINDOW, WINDOW), np.float32)
    faint = (90 + deviation * (patch - patch.mean()) / patch.std()).astype(np.float32)
    np.testing.assert_allclose(correlation(patch, ones, faint), float(counts), atol=2e-3)


@pytest.mark.parametrize("shift", [(0, 0), (3, -2), (-5, 4)])
def test_patches_are_found_where_they_went(shift):
    dx, dy = shift
    image = texture(80, 110)
    moved = np.roll(image, (dy, dx), axis=(0, 1))
    pixels = np.array([[40, 30], [60, 45]])
    found = seek(drawn(image), pixels, moved, 6)
    np.testing.assert_array_equal(found.pixels, pixels)
    np.testing.assert_allclose(found.places, pixels + np.array(shift), atol=0.1)
    assert (found.correlations > 0.99).all()
    short = seek(drawn(image), pixels, moved, 1)
    assert np.abs(short.places - pixels).max() <= 1.5
    if max(abs(dx), abs(dy)) > 1:
        assert (short.correlations < 0.9).all()


def test_half_a_pixel_is_seen_too():
    fine = smooth(smooth(smooth(smooth(RNG.uniform(0, 255, (120, 160))))))
    first, second = fine[::2, ::2], fine[::2, 1::2]  # the second is half a pixel to the right
    found = seek(drawn(first), np.array([[40, 30]]), second, 3)
    np.testing.assert_allclose(found.places, [[39.5, 30]], atol=0.15)


def test_near_the_border_a_patch_is_sought_as_far_as_there_is_an_image():
    image = texture()
    pixels = np.array([[HALF, HALF], [79 - HALF, 59 - HALF]])
    found = seek(drawn(image), pixels, image, 24)
    np.testing.assert_allclose(found.places, pixels, atol=0.1)


@pytest.mark.parametrize(
    ("values", "at", "peak"),
    [([0.0, 1.0, 0.0], 1, 1.0), ([0.0, 1.0, 0.5], 1, 1 + 1 / 6), ([0.5, 1.0, 0.0], 1, 1 - 1 / 6),
     ([1.0, 0.5, 0.0], 0, 0.0), ([0.0, 0.5, 1.0], 2, 2.0), ([1.0, 1.0, 1.0], 1, 1.0), ([0.0, 1.0, 1.0], 1, 1.5)],
)  # fmt: skip
def test_a_peak_lies_where_the_parabola_is_highest(values, at, peak):
    assert _peak(np.array(values), at) == pytest.approx(peak)


def test_patches_that_show_most_are_taken_apart_and_on_the_body():
    gray = texture(150, 200)
    gray[:, 120:] = 90  # a plain part
    body = np.zeros(gray.shape, bool)
    body[20:120, 30:180] = True
    pixels = distinct_pixels(drawn(gray, body))
    assert 20 < len(pixels) <= PATCHES
    x, y = pixels.T
    assert body[y, x].all()
    assert (x < 120 + HALF + 3).all()
    apart = np.abs(pixels[:, None] - pixels[None]).max(axis=2) + 99 * np.eye(len(pixels))
    assert apart.min() > APART
    whole = distinct_pixels(drawn(texture(150, 200)))
    assert len(whole) == PATCHES
    assert (whole.min(axis=0) >= HALF).all()
    assert (whole.max(axis=0) <= [199 - HALF, 149 - HALF]).all()
    assert len(distinct_pixels(drawn(np.full((60, 80), 90.0)))) == 0
    thin = np.zeros((60, 80), bool)
    thin[30:35] = True  # less than a third of any patch
    assert len(distinct_pixels(drawn(texture(), thin))) == 0


def test_patches_where_they_are_drawn_correlate_as_written_out(monkeypatch):
    gray, image, body = texture(), texture(), np.zeros((60, 80), bool)
    body[5:50, 10:70] = True
    gray[5:30, 5:45] = 90  # plain
    image[26:55, 5:45] = 90
    shown = drawn(gray, body)
    x, y = np.meshgrid(np.arange(HALF, 72, 9), np.arange(HALF, 52, 9))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    pixels = np.array([(u, v) for u, v in pixels if body[v, u]])
    monkeypatch.setattr(drawn_patches, "draw", lambda model, q: shown)
    monkeypatch.setattr(drawn_patches, "distinct_pixels", lambda given: pixels)
    expected = []
    for u, v in pixels:
        window = np.s_[v - HALF : v + HALF + 1, u - HALF : u + HALF + 1]
        weights = body[window].astype(float)
        if gray[window][weights > 0].std() >= LEAST_SPREAD:
            plain = image[window][weights > 0].std() < np.sqrt(0.5) * LEAST_SPREAD
            expected.append(0.0 if plain else reference(gray[window], weights, image[window])[0, 0])
    found = correlations(None, np.zeros(1), image)
    assert 0 < len(expected) < len(pixels)
    assert 0.0 in expected
    np.testing.assert_allclose(found, np.maximum(expected, 0), atol=1e-4)
    monkeypatch.setattr(drawn_patches, "distinct_pixels", lambda given: np.zeros((0, 2), int))
    assert correlations(None, np.zeros(1), image).shape == (0,)


def test_the_most_distinct_come_first_and_of_equals_the_upper_left():
    gray = np.zeros((80, 120))
    for u, v, high in ((20, 20, 100), (60, 20, 150), (100, 20, 100), (60, 60, 100)):
        gray[v, u] = high  # a window that holds the whole spot shows as much wherever it lies
    pixels = distinct_pixels(drawn(gray))
    np.testing.assert_array_equal(pixels[0], [60 - HALF + 1, 20 - HALF + 1])
    left = pixels[(pixels[:, 0] < 40) & (pixels[:, 1] < 40)]
    np.testing.assert_array_equal(left[0], [20 - HALF + 1, 20 - HALF + 1])


def test_a_body_is_drawn_as_it_looked_and_agrees_with_its_image():
    arm = TexturedArm()
    model = arm.model()
    q, other = postures(2)
    shown = draw(model, q)
    body = shown.there.body
    assert shown.gray.shape == SIZE
    assert not shown.gray[~body].any()
    inner = np.abs(shown.gray - smooth(arm.image(q)))[body]
    assert np.median(inner) < 6
    assert agreement(model, q, arm.image(q)) > 0.93
    assert agreement(model, other, arm.image(q)) < 0.5
    found = correlations(model, other, smooth(arm.image(q)))
    assert len(found) == PATCHES
    assert found.min() == 0  # what is opposite is as bad as what has nothing to do with it
    assert agreement(model, q, np.full(SIZE, 90, np.uint8)) == 0
    away = SimpleNamespace(
        image=lambda q: BodyImage(np.full(SIZE, -1), np.full(SIZE, BACKGROUND), np.full(SIZE, np.inf)),
        surface=model.surface,
    )
    assert agreement(away, q, arm.image(q)) == 0


def test_an_image_that_is_smaller_than_a_patch_has_none(monkeypatch):
    small = drawn(texture(WINDOW - 1, 80))
    monkeypatch.setattr(drawn_patches, "draw", lambda *_: small)
    assert correlations(None, np.zeros(2), small.gray).shape == (0,)
    assert agreement(None, np.zeros(2), small.gray.astype(np.uint8)) == 0.0
    assert len(seek(small, distinct_pixels(small), small.gray, 3).pixels) == 0
