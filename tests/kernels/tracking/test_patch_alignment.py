"""Patch alignment against exact motion and OpenCV's ECC (the same criterion, its own sampling and iterations)."""

from functools import cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import warp as wp
from scipy.ndimage import map_coordinates

from dense_vs.kernels.tracking.patch_alignment import PatchAlignment, Patches, define_patches

COUNT = 60
HEIGHT, WIDTH = 96, 128
BORDER = 3  # px of image around OpenCV's template, so that its blur sees what is there; masked out

# Means of 60 patches: pixels [px]. OpenCV samples bilinearly after a blur, which is its own error, see below.
MEDIAN_DIFFERENCE, NEARLY_ALL_DIFFERENCE = 0.02, 0.05


def textures(rng, count):
    """Functions of (..., 2) places to gray values: sums of 24 waves of 5 to 25 px."""
    for _ in range(count):
        angle, wavelength = rng.uniform(0, np.pi, 24), rng.uniform(5, 25, 24)
        waves = 2 * np.pi / wavelength * np.array([np.cos(angle), np.sin(angle)])
        phases = rng.uniform(0, 2 * np.pi, 24)
        yield lambda places, k=waves, c=phases: 127 + 11.5 * np.cos(places @ k + c).sum(axis=-1)


def quantized(gray, noise, rng):
    return np.clip(np.rint(gray + rng.normal(0, noise, gray.shape)), 0, 255).astype(np.uint8)


def affine_cases(*, noise, offset, mask, seed=0, count=COUNT):
    """Patches seen again turned, scaled, sheared, moved, and in another light; each in a world of its own."""
    return SimpleNamespace(**{name: a.copy() for name, a in make_cases(noise, offset, mask, seed, count).items()})


@cache
def make_cases(noise, offset, mask, seed, count):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    pixels = np.stack([x, y], axis=-1)
    cases = SimpleNamespace(before=[], after=[], weights=[], start=[], truth=[], affine=[], guess=[])
    for texture in textures(rng, count):
        start = np.array([64.0, 48.0]) + rng.integers(-40, 40, 2) / 10
        angle, scale = rng.normal(0, 0.2), np.exp(rng.normal(0, 0.1))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        affine = scale * turn + rng.normal(0, 0.05, (2, 2))
        truth = start + rng.uniform(-3, 3, 2)
        there = start + (pixels - truth) @ np.linalg.inv(affine).T
        gain, light = rng.uniform(0.8, 1.1), rng.uniform(-10, 10)
        cases.before.append(quantized(texture(pixels), noise, rng))
        cases.after.append(quantized(127 + gain * (texture(there) - 127) + light, noise, rng))
        direction = rng.uniform(0, 2 * np.pi)
        side = (pixels - start) @ [np.cos(direction), np.sin(direction)]
        cases.weights.append(np.ones((HEIGHT, WIDTH)) if mask == "whole" else side < 6)
        toward = rng.uniform(0, 2 * np.pi)
        cases.start.append(start)
        cases.truth.append(truth)
        cases.affine.append(affine + rng.normal(0, 0.03, (2, 2)))
        cases.guess.append(truth + offset * np.array([np.cos(toward), np.sin(toward)]))
    return {name: np.array(value) for name, value in vars(cases).items()}


def run(cases, window, device="cpu"):
    """Places, affine maps and correlations by the kernels; outputs begin as NaN, so what is not written shows."""
    worlds = len(cases.start)
    start, guess = (wp.array(a[:, None], dtype=wp.vec2d, device=device) for a in (cases.start, cases.guess))
    affine = wp.array(cases.affine[:, None].astype(np.float32), dtype=wp.mat22, device=device)
    patches = Patches.empty(worlds, 1, window, device)
    weights = wp.array(cases.weights.astype(np.float32), device=device)
    every = wp.full(worlds, 1, dtype=int, device=device)
    define_patches(patches, wp.array(cases.before, device=device), weights, start, every)
    outputs = [wp.empty_like(guess), wp.empty_like(affine), wp.empty((worlds, 1), dtype=float, device=device)]
    for array in outputs:
        array.fill_(float("nan"))
    PatchAlignment(patches, wp.array(cases.after, device=device), guess, affine, *outputs)()
    return [array.numpy()[:, 0] for array in outputs]


def crop(image, point, half, flags=cv2.INTER_LINEAR):
    matrix = np.array([[1, 0, point[0] - half], [0, 1, point[1] - half]])
    side = 2 * half + 1
    image = image.astype(np.float32)
    return cv2.warpAffine(
        image, matrix, (side, side), flags=flags | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )


def opencv(cases, window):
    """Places and correlations by cv2.findTransformECCWithMask; NaN and -1 where it gives up."""
    half = window // 2 + BORDER
    margin = half + half // 2 + 3
    center = np.array([margin, margin])
    places, correlations = [], []
    for k in range(len(cases.start)):
        mask = (crop(cases.weights[k], cases.start[k], half) >= 0.5).astype(np.uint8) * 255
        inner = np.zeros_like(mask)
        inner[BORDER:-BORDER, BORDER:-BORDER] = 255
        region = crop(cases.after[k], cases.guess[k], margin)
        warp = np.column_stack([cases.affine[k], center - cases.affine[k] @ (half, half)]).astype(np.float32)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-6)
        template, everywhere = crop(cases.before[k], cases.start[k], half), np.full(region.shape, 255, np.uint8)
        try:
            correlation, warp = cv2.findTransformECCWithMask(
                template, region, mask & inner, everywhere, warp, cv2.MOTION_AFFINE, criteria, 3
            )
            places.append(cases.guess[k] + warp @ (half, half, 1.0) - center)
        except cv2.error:
            correlation = -1.0
            places.append([np.nan, np.nan])
        correlations.append(correlation)
    return np.array(places), np.array(correlations)


def distance(a, b):
    return np.linalg.norm(a - b, axis=-1)


@pytest.mark.parametrize(
    ("window", "mask", "noise"),
    [(25, "whole", 0), (25, "whole", 3), (25, "part", 1), (35, "whole", 3), (35, "part", 3), (41, "part", 2)],
)
def test_same_places_as_opencv(window, mask, noise):
    cases = affine_cases(noise=noise, offset=1.0, mask=mask)
    ours, _, correlation = run(cases, window)
    theirs, their_correlation = opencv(cases, window)
    between = distance(ours, theirs)
    assert np.median(between) < MEDIAN_DIFFERENCE
    assert np.quantile(between, 0.95) < NEARLY_ALL_DIFFERENCE
    np.testing.assert_allclose(correlation, their_correlation, atol=0.01)


@pytest.mark.parametrize("window", [15, 25, 41])
@pytest.mark.parametrize("mask", ["whole", "part"])
@pytest.mark.parametrize("noise", [0, 2, 5])
def test_nearer_the_truth_than_opencv(window, mask, noise):
    cases = affine_cases(noise=noise, offset=1.0, mask=mask, seed=1)
    ours, affine, _ = run(cases, window)
    theirs, _ = opencv(cases, window)
    assert np.median(distance(ours, cases.truth)) < np.nanmedian(distance(theirs, cases.truth))
    if noise == 0:
        assert np.quantile(distance(ours, cases.truth), 0.95) < 0.03
        assert np.abs(affine - cases.affine).max() < 0.2  # warm starts are that far away
        assert np.linalg.det(affine).min() > 0


@pytest.mark.parametrize("offset", [2, 3, 4, 5])
def test_finds_patches_from_as_far_as_opencv(offset):
    cases = affine_cases(noise=2, offset=offset, mask="whole", seed=2, count=100)
    ours, _, _ = run(cases, 25)
    theirs, _ = opencv(cases, 25)
    found, theirs_found = (int((distance(places, cases.truth) < 0.5).sum()) for places in (ours, theirs))
    assert found >= theirs_found - 3
    if offset <= 3:
        assert found >= 90


def test_correlation_says_where_the_patch_is_not():
    cases = affine_cases(noise=2, offset=1.0, mask="whole", count=30)
    cases.after = np.roll(cases.after, 1, axis=0)  # each world sees another one's texture
    _, _, correlation = run(cases, 25)
    assert correlation.max() < 0.85
    assert (correlation >= -1).all()


def correlations_of(cases, places, affine, window):
    """Of patches and what is seen at places, float64; of whole patches that lie inside of the image."""
    half = window // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1)
    offsets = np.column_stack([x, y])

    def seen(image, at):
        return map_coordinates(image.astype(float), at.T[::-1], order=3, prefilter=False)

    pairs = [
        (seen(before, start + offsets), seen(after, place + offsets @ turn.T.astype(float)))
        for before, start, after, place, turn in zip(
            cases.before, cases.start, cases.after, places, affine, strict=True
        )
    ]
    return np.array([np.corrcoef(*pair)[0, 1] for pair in pairs])


@pytest.mark.parametrize("gain", [1.0, 0.05, 0.01])
@pytest.mark.parametrize("light", [0, 110, -110])
def test_correlation_is_that_of_the_pixels_on_plain_and_bright_surfaces_too(gain, light):
    """At 1 % of the textures' contrast gray values vary by a tenth, and their squares are 16,000."""
    cases = affine_cases(noise=0, offset=1.0, mask="whole", seed=4)
    rng = np.random.default_rng(5)
    for images in (cases.before, cases.after):
        images[...] = quantized(127 + gain * (images.astype(float) - 127) + light, 0.4, rng)
    places, affine, correlation = run(cases, 25)
    expected = correlations_of(cases, places, affine, 25)
    np.testing.assert_allclose(correlation, expected, atol=2e-3)  # of the last step; that before it is given
    assert np.median(np.abs(correlation - expected)) < 5e-4
    assert correlation.max() <= 1


@pytest.mark.parametrize("what", ["before", "after", "weights"])
def test_nothing_to_align(what):
    """A flat patch, a flat image, or no pixel that counts: the guess stays."""
    cases = affine_cases(noise=2, offset=1.0, mask="whole", count=3)
    getattr(cases, what)[...] = 0
    places, affine, correlation = run(cases, 25)
    np.testing.assert_array_equal(places, cases.guess)
    np.testing.assert_array_equal(affine, cases.affine.astype(np.float32))
    np.testing.assert_array_equal(correlation, -1)


def test_one_edge_holds_the_point_across_and_lets_it_slide_along():
    image = np.full((2, HEIGHT, WIDTH), 60, np.uint8)
    image[:, :, 64:] = 180
    image[1] = np.roll(image[1], 2, axis=1)
    one = np.array([[64.0, 48.0]])
    cases = SimpleNamespace(
        before=image[:1],
        after=image[1:],
        weights=np.ones((1, HEIGHT, WIDTH)),
        start=one,
        guess=one + np.array([1.0, 0.5]),
        affine=np.eye(2)[None],
    )
    places, _, _ = run(cases, 25)
    assert abs(places[0, 0] - 66) < 0.1 or (places == cases.guess).all()
    assert np.isfinite(places).all()


def test_what_left_the_image_does_not_count():
    """Up to 40 % of a patch is beyond the right border, where its nearest pixel would answer."""
    cases = affine_cases(noise=1, offset=0.5, mask="whole", seed=3)
    cut = 70
    cases.after = np.ascontiguousarray(cases.after[:, :, :cut])
    places, _, correlation = run(cases, 25)
    shown = (cases.truth[:, 0] < cut - 3) & (cases.truth[:, 0] > cut - 10)
    assert shown.sum() > 10
    assert np.median(distance(places, cases.truth)[shown]) < 0.03
    assert correlation[shown].min() > 0.98


def test_far_outside_the_image_and_without_a_number():
    cases = affine_cases(noise=1, offset=0.5, mask="whole", count=4)
    cases.guess[:] = [[1e30, 5.0], [-4000.0, 20.0], [np.nan, 0.0], [60.0, np.inf]]
    places, _, correlation = run(cases, 25)
    np.testing.assert_array_equal(places, cases.guess)
    np.testing.assert_array_equal(correlation, -1)


def test_worlds_and_points_are_independent():
    cases = affine_cases(noise=2, offset=1.0, mask="part", count=6)
    together = run(cases, 25)
    for k in range(6):
        alone = run(SimpleNamespace(**{name: a[k : k + 1] for name, a in vars(cases).items()}), 25)
        for many, one in zip(together, alone, strict=True):
            np.testing.assert_array_equal(many[k : k + 1], one)


def test_defines_only_the_chosen_worlds():
    cases = affine_cases(noise=0, offset=1.0, mask="whole", count=3)
    patches = Patches.empty(3, 1, 9, "cpu")
    start = wp.array(cases.start[:, None], dtype=wp.vec2d, device="cpu")
    weights = wp.ones((3, HEIGHT, WIDTH), dtype=float, device="cpu")
    image = wp.array(cases.before, device="cpu")
    define_patches(patches, image, weights, start, wp.array([0, 1, 0], dtype=int, device="cpu"))
    pixels = patches.pixels.numpy()
    assert (pixels[1, 0, :, 1] == 1).all()
    assert pixels[1, 0, :, 0].std() > 1
    np.testing.assert_array_equal(pixels[[0, 2]], 0)


@pytest.mark.gpu
def test_the_same_on_a_gpu():
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    cases = affine_cases(noise=2, offset=2.0, mask="part")
    for cpu, gpu in zip(run(cases, 25), run(cases, 25, "cuda:0"), strict=True):
        np.testing.assert_allclose(cpu, gpu, atol=0.01)  # px: what the last iteration may leave


def test_points_that_threads_share_out_come_out_the_same():
    cases = SimpleNamespace(**make_cases(2.0, 1.0, "whole", 5, 7))
    image = np.repeat(cases.after[:1], 2, axis=0)
    guess = np.stack([cases.guess, cases.guess[::-1] + 0.5])  # (2 worlds, 7 points)
    affine = np.stack([cases.affine, cases.affine[::-1]]).astype(np.float32)
    found = []
    for threads in (1, 2, 3, 16):
        patches = Patches.empty(2, 7, 15, "cpu")
        places = wp.array(guess, dtype=wp.vec2d, device="cpu")
        everywhere = wp.array(np.ones(image.shape, np.float32), device="cpu")
        define_patches(
            patches, wp.array(image, device="cpu"), everywhere, places, wp.full(2, 1, dtype=int, device="cpu")
        )
        outputs = [wp.empty((2, 7), dtype=kind, device="cpu") for kind in (wp.vec2d, wp.mat22, float)]
        for array in outputs:
            array.fill_(float("nan"))
        start = wp.array(affine, dtype=wp.mat22, device="cpu")
        PatchAlignment(patches, wp.array(image, device="cpu"), places, start, *outputs)(threads=threads)
        found.append([array.numpy() for array in outputs])
    assert (found[0][2] > 0.5).any()
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("threads", [1, 3])
def test_no_points_are_aligned_to_nothing(threads):
    patches = Patches.empty(1, 0, 15, "cpu")
    outputs = [wp.zeros((1, 0), dtype=kind, device="cpu") for kind in (wp.vec2d, wp.mat22, float)]
    image = wp.zeros((1, HEIGHT, WIDTH), dtype=wp.uint8, device="cpu")
    PatchAlignment(patches, image, *(wp.zeros_like(one) for one in outputs[:2]), *outputs)(threads=threads)
    assert all(one.shape == (1, 0) for one in outputs)
