"""Superpixels, sums over regions and features of pixels, each against its definition, pixel by pixel."""

import cv2
import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.segmentation.few_shot.decision_forest import DecisionForest
from dense_vs.segmentation.few_shot.pixel_channels import pixel_channels
from dense_vs.segmentation.few_shot.pixel_features import NEAR, WIDE, PixelFeatures
from dense_vs.segmentation.few_shot.region_features import _shape, border_figures, superpixel_figures
from dense_vs.segmentation.few_shot.region_tree import region_trees
from dense_vs.segmentation.few_shot.superpixels import find_superpixels

SHAPE = (50, 61)  # no multiple of a cell


@pytest.fixture(scope="module")
def scene():
    """Channels, superpixels, and a random probability of each."""
    rng = np.random.default_rng(0)
    soft = cv2.GaussianBlur(rng.random((*SHAPE, 3)).astype(np.float32), (0, 0), 2.5)
    image = np.clip(128 + 900 * (soft - 0.5), 0, 255).astype(np.uint8)
    channels = pixel_channels(image)
    pixels = find_superpixels(channels, 8)
    return channels, pixels, rng.random(pixels.count)


def test_superpixels_are_numbered_without_a_gap_and_their_members_are_counted(scene):
    _, pixels, _ = scene
    assert 20 < pixels.count < 300
    assert np.unique(pixels.labels).tolist() == list(range(pixels.count))
    for label in range(pixels.count):
        row = pixels.members.getrow(label)
        assert row.indices.tolist() == np.flatnonzero(pixels.labels == label).tolist()
        assert pixels.area[label] == row.nnz == row.sum()
        edge = np.ones(SHAPE, dtype=bool)
        edge[1:-1, 1:-1] = False
        assert pixels.rim[label] == np.count_nonzero(edge & (pixels.labels == label))


def test_borders_are_those_between_neighboring_pixels(scene):
    channels, pixels, _ = scene
    smooth = cv2.GaussianBlur(channels.lab, (0, 0), 1.0).astype(np.float64)
    slopes = [cv2.Sobel(smooth, cv2.CV_64F, *order) for order in ((1, 0), (0, 1))]
    gradient = np.sqrt(sum((slope**2).sum(axis=2) for slope in slopes))
    length, strength = {}, {}
    for y in range(SHAPE[0]):
        for x in range(SHAPE[1]):
            for other in ((y, x + 1), (y + 1, x)):
                if other[0] < SHAPE[0] and other[1] < SHAPE[1]:
                    pair = tuple(sorted((int(pixels.labels[y, x]), int(pixels.labels[other]))))
                    if pair[0] != pair[1]:
                        length[pair] = length.get(pair, 0) + 1
                        strength[pair] = strength.get(pair, 0.0) + max(gradient[y, x], gradient[other])
    pairs = list(zip(pixels.first.tolist(), pixels.second.tolist(), strict=True))
    assert pairs == sorted(length)
    assert pixels.length.tolist() == [length[pair] for pair in pairs]
    np.testing.assert_allclose(pixels.strength, [strength[pair] for pair in pairs], rtol=1e-4)


def test_an_image_of_one_superpixel_has_no_border():
    pixels = find_superpixels(pixel_channels(np.full((16, 16, 3), 90, np.uint8)), 16)
    assert pixels.count == 1
    assert [len(part) for part in (pixels.first, pixels.second, pixels.length, pixels.strength)] == [0] * 4
    (tree,) = region_trees(pixels, np.zeros((1, 1, 2)))
    assert tree.mask(pixels, 0).all()


def test_sums_over_superpixels(scene):
    channels, pixels, _ = scene
    figures = superpixel_figures(channels, pixels)
    for label in range(0, pixels.count, 7):
        y, x = np.nonzero(pixels.labels == label)
        assert figures.place[label].tolist() == [x.sum(), y.sum(), (x * x).sum(), (y * y).sum(), (x * y).sum()]
        np.testing.assert_allclose(figures.planes[label], channels.planes[y, x].sum(axis=0), rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(figures.squares[label], (channels.lab[y, x] ** 2).sum(axis=0), rtol=1e-5)
        assert figures.patterns[label].tolist() == np.bincount(channels.patterns[y, x], minlength=10).tolist()


def test_what_lies_around_a_region_is_counted_along_its_outline(scene):
    channels, pixels, likely = scene
    words = np.stack([pixels.area * likely, pixels.area * (1 - likely)], axis=1)
    figures = superpixel_figures(channels, pixels)
    borders = border_figures(figures, pixels, likely, words)
    features = np.stack([figures.planes[:, :3] / pixels.area[:, None], np.stack([likely] * 3, axis=1)])
    for tree in region_trees(pixels, features):
        ring = tree.boundary_sums(tree.node_sums(borders.around), borders.of_pair)
        for node in [*range(0, len(tree.parent), 17), len(tree.parent) - 1]:
            inside = np.zeros(pixels.count, dtype=bool)
            inside[np.unique(pixels.labels[tree.mask(pixels, node)])] = True
            outline = inside[pixels.first] != inside[pixels.second]
            beyond = np.where(inside[pixels.first], pixels.second, pixels.first)[outline]
            length = pixels.length[outline]
            outside = [
                *(figures.planes[beyond, :3] / pixels.area[beyond, None]).T,
                *(words[beyond] / pixels.area[beyond, None]).T,
                likely[beyond],
            ]
            expected = [length.sum(), pixels.strength[outline].sum(), *(length @ column for column in outside)]
            np.testing.assert_allclose(ring[node], expected, rtol=1e-6, atol=1e-6 * pixels.length.sum())
            assert np.count_nonzero(tree.mask(pixels, node)) == tree.node_sums(pixels.area[:, None])[node, 0]


def test_features_of_pixels_are_means_and_spreads_plane_by_plane(scene):
    channels, _, _ = scene
    height, width = SHAPE
    y, x = (part.ravel() for part in np.mgrid[0:height:7, 0:width:5])
    y, x = np.append(y, height - 1), np.append(x, width - 1)
    cells = (width // 4, height // 4)
    row, column = np.minimum(y // 4, cells[1] - 1), np.minimum(x // 4, cells[0] - 1)

    def reduced(plane):
        return cv2.resize(plane, cells, interpolation=cv2.INTER_AREA)

    def blurred(planes, sigma, place):
        return [cv2.GaussianBlur(plane, (0, 0), sigma)[place].astype(np.float64) for plane in planes]

    planes = [np.ascontiguousarray(channels.planes[..., c]) for c in range(10)]
    squares = [plane**2 for plane in planes[:3]]
    kinds = [np.where(channels.patterns == kind, 255, 0).astype(np.uint8) for kind in range(10)]
    expected = [plane[y, x] for plane in planes]
    for scales, fine, place in (
        (NEAR, planes + squares, (y, x)),
        (WIDE, [reduced(plane) for plane in planes + squares], (row, column)),
    ):
        for sigma in scales:
            found = blurred(fine, sigma, place)
            spread = [np.sqrt(np.maximum(s - m**2, 0)) for s, m in zip(found[10:], found[:3], strict=True)]
            expected += [*found[:10], *spread]
            if scales is WIDE:
                expected += blurred([reduced(kind) for kind in kinds], sigma, place)
    given = PixelFeatures(channels).at(y, x)
    assert given.dtype == np.float32
    np.testing.assert_allclose(given, np.stack(expected, axis=1), atol=1e-3)


def test_a_forest_that_cannot_be_packed_is_refused():
    one, none = np.array([1, -1, -1], np.int32), np.zeros(3, np.float32)
    feature = np.array([1 << 29, -1, -1], np.int32)
    with pytest.raises(DenseVSError, match="3 nodes; expected less than 2"):
        DecisionForest(1 << 30, np.zeros(1, np.int32), feature, none, one, one + 1, none)


@pytest.mark.parametrize(
    ("pixels", "perimeter", "elongation", "compactness"),
    [
        ([(0, 0), (1, 0), (0, 1), (1, 1)], 8, 0.0, np.pi / 4),
        ([(0, 0), (1, 0), (2, 0), (3, 0)], 10, np.log(4.0), 16 * np.pi / 100),  # four times as long as it is wide
        ([(5, 1), (5, 2), (5, 3), (5, 4)], 10, np.log(4.0), 16 * np.pi / 100),
    ],
)
def test_the_shape_of_a_few_pixels(pixels, perimeter, elongation, compactness):
    """A rectangle's area is 3 / pi of that of the ellipse of the same moments, a / 12 and b / 12 squared."""
    x, y = np.array(pixels, float).T
    place = np.array([[x.sum(), y.sum(), (x * x).sum(), (y * y).sum(), (x * y).sum()]])
    found = _shape(np.array([[4.0]]), place, np.array([[float(perimeter)]]))
    np.testing.assert_allclose(np.ravel(found), [elongation, 3 / np.pi, compactness], atol=1e-12)


def test_the_shape_of_a_slanted_line():
    """Three pixels along a diagonal: variances of 4/3 + 1/12 along it and 1/12 across it."""
    x = np.arange(3.0)
    place = np.array([[x.sum(), x.sum(), (x * x).sum(), (x * x).sum(), (x * x).sum()]])
    elongation, *_ = _shape(np.array([[3.0]]), place, np.array([[12.0]]))
    assert elongation.item() == pytest.approx(np.log((4 / 3 + 1 / 12) * 12) / 2)
