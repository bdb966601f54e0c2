"""Colors, edges and patterns of a pixel beside their formulas in float64, and seeds of superpixels cell by cell."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter

from dense_vs.segmentation.few_shot.pixel_channels import _patterns, _texture, pixel_channels
from dense_vs.segmentation.few_shot.superpixels import _add_blobs, _numbered, _seeds, find_superpixels


def cie_lab(rgb):
    """CIE Lab of sRGB values 0 to 1 under the standard daylight."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    )
    x, y, z = np.moveaxis(linear @ to_xyz.T / to_xyz.sum(axis=1), -1, 0)
    x, y, z = (np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116) for t in (x, y, z))
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def test_colors_of_a_pixel():
    image = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)
    image[0, :4] = [[0, 0, 0], [255, 255, 255], [0, 90, 250], [200, 10, 10]]
    found = pixel_channels(image).planes
    rgb = image / 255.0
    np.testing.assert_allclose(found[..., :3], cie_lab(rgb) * [0.01, 0.015, 0.015], atol=8e-3)
    red, green, blue = np.moveaxis(rgb, -1, 0)
    total = rgb.sum(axis=2) + 0.15
    np.testing.assert_allclose(found[..., 3], (red - green) / total, atol=1e-5)
    np.testing.assert_allclose(found[..., 4], (2 * blue - red - green) / total, atol=1e-5)
    np.testing.assert_allclose(found[..., 5], np.ptp(rgb, axis=2) / (rgb.max(axis=2) + 0.1), atol=1e-5)


def test_textures_are_lengths():
    lightness = gaussian_filter(np.random.default_rng(1).random((40, 50)), 1.5).astype(np.float32)
    found = _texture(lightness)
    for scale, sigma in enumerate((0.8, 1.6)):
        smooth = gaussian_filter(lightness.astype(float), sigma, mode="mirror", radius=round(4 * sigma + 0.5))
        wide = np.pad(smooth, 1, mode="reflect")
        dx = (wide[:, 2:] - wide[:, :-2]) / 2
        dy = (wide[2:] - wide[:-2]) / 2
        dx, dy = (dx[:-2] + 2 * dx[1:-1] + dx[2:]) / 4, (dy[:, :-2] + 2 * dy[:, 1:-1] + dy[:, 2:]) / 4
        bend = wide[2:, 1:-1] + wide[:-2, 1:-1] + wide[1:-1, 2:] + wide[1:-1, :-2] - 4 * smooth
        np.testing.assert_allclose(found[2 * scale], sigma * np.hypot(dx, dy), rtol=2e-3, atol=1e-4)
        np.testing.assert_allclose(found[2 * scale + 1], sigma**2 / 4 * np.abs(bend), rtol=2e-3, atol=1e-4)
        assert bend.min() < -0.003


def test_patterns_are_of_neighbors_that_are_lighter_by_a_hundredth():
    lightness = np.random.default_rng(2).random((30, 40)).astype(np.float32)
    lightness[10:20] = 0.5 + 0.02 * lightness[10:20]  # differences about as large as what counts
    lightness[22:26, 10:30] = 0.0
    lightness[23, 11:29:2] = np.float32(0.01)  # just as much as would not count
    lightness[0:9, :20] = gaussian_filter(lightness[0:9, :20], 2.0)
    found = _patterns(lightness)
    wide = np.pad(lightness, 1, mode="reflect")
    ring = [(-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1)]
    kinds = set()
    for y, x in np.ndindex(lightness.shape):
        lighter = [wide[1 + y + v, 1 + x + u] > lightness[y, x] + np.float32(0.01) for v, u in ring]
        changes = sum(lighter[k] != lighter[(k + 1) % 8] for k in range(8))
        assert found[y, x] == (sum(lighter) if changes <= 2 else 9)
        kinds.add(int(found[y, x]))
    assert kinds == set(range(10))


@pytest.mark.parametrize("cell", [8, 10, 16])
def test_a_seed_is_the_flattest_pixel_of_the_inside_of_a_cell(cell):
    gradient = np.random.default_rng(3).random((50, 70)).astype(np.float32)
    markers = _seeds(gradient, cell)
    expected = np.zeros(gradient.shape, int)
    number, margin = 0, cell // 4
    for top in range(0, 50 - cell + 1, cell):
        for left in range(0, 70 - cell + 1, cell):
            number += 1
            inside = gradient[top + margin : top + cell - margin, left + margin : left + cell - margin]
            y, x = np.argwhere(inside == inside.min())[0]
            expected[top + margin + y, left + margin + x] = number
    np.testing.assert_array_equal(markers, expected)


def test_blobs_are_peaks_of_the_difference_of_gaussians_that_no_seed_is_beside():
    rng = np.random.default_rng(4)
    lab = np.full((60, 80, 3), 0.4, np.float32)
    for channel, (y, x), height in (
        (0, (12, 12), 0.3), (0, (12, 40), -0.3), (1, (30, 20), 0.3), (2, (30, 60), -0.3),
        (0, (48, 15), 0.1), (0, (48, 40), 0.04), (1, (48, 66), 0.45), (0, (12, 70), 0.4),
    ):  # fmt: skip
        lab[y - 2 : y + 3, x - 2 : x + 3, channel] += height
    lab += rng.normal(0, 1e-3, lab.shape).astype(np.float32)
    markers = np.zeros((60, 80), np.int32)
    markers[31, 61], markers[5, 5], markers[12, 68] = 1, 7, 3  # the first is beside a blob, the last is not
    given = markers.copy()
    _add_blobs(markers, lab)
    small, large = (gaussian_filter(lab.astype(float), (sigma, sigma, 0), mode="mirror") for sigma in (1.6, 1.6 * 1.6))
    contrast = np.sqrt(((small - large) ** 2).sum(axis=2))
    peak = contrast == maximum_filter(contrast, 5, mode="constant", cval=-np.inf)
    taken = maximum_filter(given, 3) > 0
    places = np.argwhere(peak & (contrast > 0.03) & ~taken)
    assert len(places) == 6  # without the faint one, and the one beside a seed
    expected = given.copy()
    for number, (y, x) in enumerate(places, start=8):
        expected[y, x] = number
    np.testing.assert_array_equal(markers, expected)


@pytest.mark.parametrize("colors", [((60, 35, 0), (60, -35, 0)), ((60, 0, 40), (60, 0, -40)), ((45, 0, 0), (70, 0, 0))])
def test_no_superpixel_crosses_an_edge_of_lightness_or_of_one_opponent_color(colors):
    lab = np.zeros((64, 64, 3), np.float32)
    lab[:] = colors[0]
    x = np.arange(64)
    beyond = np.add.outer(np.arange(64) // 4, x) > 37  # a slanted edge, which passes through the cells
    lab[beyond] = colors[1]
    lab[..., 0] += np.random.default_rng(5).normal(0, 5, (64, 64))
    rgb = np.rint(255 * np.clip(cv2.cvtColor(lab, cv2.COLOR_Lab2RGB), 0, 1)).astype(np.uint8)
    pixels = find_superpixels(pixel_channels(rgb), 16)
    share = pixels.sums(beyond.astype(float))[:, 0] / pixels.area
    mixed = np.minimum(share, 1 - share) * pixels.area
    assert mixed.sum() < 48  # of an edge of 64 px, less than a pixel to either side


def test_labels_that_occur_are_numbered_though_they_occur_once():
    np.testing.assert_array_equal(_numbered(np.array([[1, 3, 3], [9, 9, 6]], np.int32)), [[0, 1, 1], [3, 3, 2]])
