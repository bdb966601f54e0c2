"""Patches of a drawn body: which are chosen, and where an image looks most like them, against sums written out."""

from types import SimpleNamespace

import numpy as np
import pytest
from textured_arm import SIZE, TexturedArm, postures

from dense_vs.body_model.chain import BACKGROUND
from dense_vs.body_model.drawn_patches import (
    APART,
    HALF,
    PATCHES,
    WINDOW,
    DrawnBody,
    _correlation,
    _peak,
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


def test_the_correlation_is_that_of_what_is_body():
    image = texture()
    weights = (RNG.random((WINDOW, WINDOW)) < 0.6).astype(np.float32)
    patch, around = image[10 : 10 + WINDOW, 20 : 20 + WINDOW].copy(), image[5:35, 12:50]
    patch[weights == 0] = 1e3  # what is behind does not matter
    found = _correlation(patch, weights, around)
    np.testing.assert_allclose(found, reference(patch, weights, around), atol=2e-3)
    assert np.unravel_index(found.argmax(), found.shape) == (5, 8)
    dimmed = _correlation(patch, weights, (0.5 * around + 30).astype(np.float32))
    np.testing.assert_allclose(dimmed, found, atol=5e-3)  # exposure does not matter


def test_what_is_plain_tells_nothing():
    image, ones = texture(), np.ones((WINDOW, WINDOW), np.float32)
    faint = (1.9 * np.sign(RNG.normal(size=(WINDOW, WINDOW))) + 90).astype(np.float32)  # deviates by less than 2
    assert _correlation(faint, ones, image) is None
    assert _correlation(1.2 * faint, ones, image) is not None
    assert not _correlation(image[:WINDOW, :WINDOW], ones, np.full((30, 30), 90, np.float32)).any()


@pytest.mark.parametrize(("deviation", "counts"), [(1.3, False), (1.6, True)])  # gray levels; half of 2^2 is 1.41^2
def test_an_image_that_is_plain_there_looks_like_nothing(deviation, counts):
    patch, ones = texture()[:WINDOW, :WINDOW], np.ones((WINDOW, WINDOW), np.float32)
    faint = (90 + deviation * (patch - patch.mean()) / patch.std()).astype(np.float32)
    np.testing.assert_allclose(_correlation(patch, ones, faint), float(counts), atol=2e-3)


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
