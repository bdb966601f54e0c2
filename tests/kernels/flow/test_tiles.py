"""Flow in tiles, as a GPU computes it: its expansion in float64, its flow in passes, and its threads in blocks."""

import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.flow import tile_level
from dense_vs.kernels.flow.farneback import Farneback, FarnebackOptions
from dense_vs.kernels.flow.farneback_level import LevelTables
from dense_vs.kernels.flow.tile_level import TileLevel, tiles_fit
from tests.kernels.flow.test_farneback import between, motions, moved, texture

DEFAULT = FarnebackOptions(winsize=11, levels=2, iterations=1)
RADIUS, SIGMA = 5, 1.1


def expansion_in_float64(image: np.ndarray) -> np.ndarray:
    """(H, W, 5) of an image blurred by (1, 2, 1) / 4 and then continued by its last pixels."""
    height, width = image.shape
    padded = np.pad(image.astype(float), 1, mode="reflect")
    blurred = sum(
        weight * other * padded[a : a + height, b : b + width]
        for a, weight in enumerate((0.25, 0.5, 0.25))
        for b, other in enumerate((0.25, 0.5, 0.25))
    )
    x = np.arange(-RADIUS, RADIUS + 1)
    g = np.exp(-(x**2) / (2 * SIGMA**2))
    g /= g.sum()
    s2, s4 = (g * x**2).sum(), (g * x**4).sum()
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(blurred, RADIUS, mode="edge"), (2 * RADIUS + 1,) * 2)

    def moment(i, j):
        return np.einsum("hwab,a,b->hw", windows, g * x**j, g * x**i)

    mean = s2 * moment(0, 0)
    over = 1 / (s4 - s2**2)
    axx, ayy = ((moment(2, 0) - mean) * over, (moment(0, 2) - mean) * over)
    return np.stack([moment(1, 0) / s2, moment(0, 1) / s2, axx, ayy, moment(1, 1) / s2**2], axis=-1)


@pytest.mark.parametrize("size", [(61, 83), (30, 40)], ids=str)
def test_expansion_of_a_tile_is_that_of_float64(size):
    images = np.stack([texture(*size, seed) for seed in range(2)])
    slot = wp.array([1], dtype=int, device="cpu")
    tables = LevelTables.of(size, 1.0, 0.5, DEFAULT.window(), RADIUS, SIGMA, "cpu")
    level = TileLevel(
        wp.array(images, dtype=wp.uint8, device="cpu"), tables, DEFAULT.window(), SIGMA, slot, slot, 1, None
    )
    level.expansion.fill_(wp.uint32(0xFFFFFFFF))
    level.expand()()
    words = level.expansion.numpy()
    assert (words[:2] == 0xFFFFFFFF).all()  # the other slot
    for image, found in zip(images, words[2:], strict=True):
        b = np.ascontiguousarray(found[..., :2]).view(np.float32)
        A = np.ascontiguousarray(found[..., 2:]).view(np.float16)[..., :3].astype(float)
        exact = expansion_in_float64(image)
        np.testing.assert_allclose(b, exact[..., :2], atol=2e-4)
        np.testing.assert_allclose(A, exact[..., 2:], atol=2e-4, rtol=2.0**-11 + 1e-5)


@pytest.mark.parametrize("size", [(240, 320), (70, 90), (16, 16), (17, 61), (45, 16)], ids=str)
def test_flow_in_tiles_is_flow_in_passes(size):
    previous = np.stack([texture(*size, seed) for seed in range(2)])
    present = np.stack([moved(previous[0], motions(*size)["rotation"]), moved(previous[1], motions(*size)["local"])])
    passes = between(Farneback(2, *size, DEFAULT, device="cpu"), previous, present)
    tiles = Farneback(2, *size, DEFAULT, device="cpu", tiles=True)
    tiles.flow.fill_(wp.nan)
    found = between(tiles, previous, present)
    assert np.isfinite(found).all()
    difference = np.linalg.norm(found - passes, axis=-1)
    # A in float16 turns what an ill-conditioned window says; rounding of float32 sums does as much.
    assert difference.mean() < 1e-4
    assert np.quantile(difference, 0.999) < 0.02


def test_worlds_restart_alone_in_tiles():
    size = (40, 50)
    images = [np.stack([texture(*size, seed), texture(*size, seed)]) for seed in range(2)]
    method = Farneback(2, *size, DEFAULT, device="cpu", tiles=True)
    method.restarted.assign(np.array([0, 1], np.int32))
    u = between(method, *images)
    assert not u[1].any()
    method.restarted.zero_()
    method.calculate()
    np.testing.assert_array_equal(method.flow.numpy()[1], u[0])


def test_takes_float_images_in_tiles():
    previous = texture(60, 70)
    present = moved(previous, motions(60, 70)["rotation"])
    u = between(Farneback(1, 60, 70, tiles=True, device="cpu"), previous, present)
    f = between(Farneback(1, 60, 70, dtype=wp.float32, tiles=True, device="cpu"), previous, present)
    np.testing.assert_allclose(f, u, atol=1e-4)


@pytest.mark.parametrize("levels", [0, 2])
@pytest.mark.parametrize("tiles", [False, True], ids=["passes", "tiles"])
def test_a_flow_far_beyond_the_window_is_found_from_a_guess(tiles, levels):
    size = (120, 160)
    flow = np.broadcast_to(np.float32([11.0, -7.0]), (*size, 2))
    previous = np.stack([texture(*size, seed) for seed in range(2)])
    present = np.stack([moved(image, flow) for image in previous])
    method = Farneback(
        2, *size, FarnebackOptions(winsize=11, levels=levels, iterations=1), device="cpu", tiles=tiles, threads=2
    )
    inner = (slice(None), slice(24, -24), slice(24, -24))
    if levels == 0:
        assert np.median(np.linalg.norm(between(method, previous, present) - flow, axis=-1)[inner]) > 5
    assert method.guess.shape == (2, 30, 40)
    method.guess.assign(np.broadcast_to(0.9 * flow[::4, ::4], (*method.guess.shape, 2)).copy())
    found = between(method, previous, present)
    assert np.median(np.linalg.norm(found - flow, axis=-1)[inner]) < 0.2  # of 1.3 px that the guess leaves
    method.restarted.assign(np.array([1, 0], np.int32))
    method.calculate()
    assert not method.flow.numpy()[0].any()
    np.testing.assert_array_equal(method.flow.numpy()[1], found[1])


def test_threads_of_a_block_give_the_same_bits(monkeypatch):
    # Threads that really wait for each other: a missing wait or a cell that two phases share would show.
    size = (70, 90)
    previous = texture(*size)
    present = moved(previous, motions(*size)["local"])
    one = between(Farneback(1, *size, DEFAULT, device="cpu", tiles=True), previous, present)
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", True)
    many = between(Farneback(1, *size, DEFAULT, device="cpu", tiles=True), previous, present)
    np.testing.assert_array_equal(many, one)


def test_wide_blocks_give_the_same_bits(monkeypatch):
    # What a GPU does with few tiles: more threads, each with a row at a time.
    size = (70, 90)
    previous = texture(*size)
    present = moved(previous, motions(*size)["local"])
    one = between(Farneback(1, *size, DEFAULT, device="cpu", tiles=True), previous, present)
    monkeypatch.setattr(tile_level, "few_blocks", lambda blocks, device: True)
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", True)
    wide = between(Farneback(1, *size, DEFAULT, device="cpu", tiles=True), previous, present)
    np.testing.assert_array_equal(wide, one)


def test_a_window_that_no_tile_holds_is_computed_in_passes():
    wide = FarnebackOptions(winsize=61, levels=0)
    assert not tiles_fit(61, wide.poly_n)
    with pytest.raises(ValueError, match="no tile fits a block's memory"):
        Farneback(1, 64, 64, wide, device="cpu", tiles=True)
    assert Farneback(1, 64, 64, wide, device="cpu").flow.shape == (1, 64, 64)
