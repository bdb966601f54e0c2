"""Lengths of mask regions, against sums over their pixels."""

import cv2
import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.depth.region_shape import WIDTH_AXES, joined, mask_regions


@pytest.fixture(scope="module")
def blobs():
    noise = np.random.default_rng(3).normal(size=(2, 90, 120))
    return np.stack([cv2.GaussianBlur(image, (0, 0), 6) > 0.05 for image in noise])


def by_pixels(selected):
    """Area, centroid, moments and widths of the squares that the pixels are."""
    ys, xs = np.nonzero(selected)
    points = np.stack([xs, ys], axis=1).astype(float)
    corners = np.concatenate([points + offset for offset in np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / 2])
    moments = np.cov(points.T, bias=True) + np.eye(2) / 12
    return len(xs), points.mean(axis=0), moments, np.ptp(corners @ WIDTH_AXES, axis=0)


def assert_same(shape, selected):
    area, centroid, moments, widths = by_pixels(selected)
    assert shape.area == area
    np.testing.assert_allclose(shape.centroid, centroid, atol=1e-9)
    np.testing.assert_allclose(shape.moments, moments, atol=1e-6)
    np.testing.assert_allclose(shape.widths, widths, atol=1e-9)


def test_regions_against_pixel_sums(blobs):
    for mask, regions in zip(blobs, mask_regions(blobs), strict=True):
        count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
        sizes = sorted(((labels == k).sum(), k) for k in range(1, count))[::-1]
        assert len(regions) > 3
        assert [region.area for region in regions] == [size for size, _ in sizes[: len(regions)]]
        for region in regions:
            label = labels[tuple(np.argwhere(labels > 0)[_nearest(labels, region)])]
            assert_same(region, labels == label)
            ys, xs = np.nonzero(labels == label)
            at_border = xs.min() == 0 or ys.min() == 0 or xs.max() == 119 or ys.max() == 89
            assert region.touches_border == at_border


def _nearest(labels, region):
    """Index, among the labelled pixels, of one whose region has this area and is closest to its centroid."""
    places = np.argwhere(labels > 0)
    areas = np.bincount(labels.ravel())[labels[tuple(places.T)]]
    distance = np.linalg.norm(places[:, ::-1] - region.centroid, axis=1)
    return np.argmin(np.where(areas == region.area, distance, np.inf))


def test_joined_regions_are_as_one(blobs):
    regions = mask_regions(blobs)[0]
    assert_same(joined(regions), blobs[0])
    assert joined(regions[:1]) is regions[0]


def test_a_square_has_the_widths_of_its_corners():
    mask = np.zeros((1, 40, 40))
    mask[0, 10:20, 5:25] = 255.0
    (shape,) = mask_regions(mask)[0]
    np.testing.assert_allclose(shape.widths[[0, 2, 4, 6]], [20, 30 / np.sqrt(2), 10, 30 / np.sqrt(2)])
    np.testing.assert_allclose(np.diag(shape.moments), [20**2 / 12, 10**2 / 12])


def test_an_empty_mask_has_no_regions_and_a_full_one_touches_the_border():
    masks = np.stack([np.zeros((8, 9), bool), np.ones((8, 9), bool)])
    empty, full = mask_regions(masks)
    assert empty == []
    assert full[0].area == 72
    assert full[0].touches_border


@pytest.mark.parametrize("masks", [np.zeros((4, 5)), np.full((1, 4, 5), np.nan), np.array([[["a"]]])])
def test_bad_masks_are_refused(masks):
    with pytest.raises(DenseVSError, match="masks"):
        mask_regions(masks)
