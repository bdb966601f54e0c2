"""Figures of masks against NumPy in float64 and OpenCV, for masks of several sizes in turn and in several threads."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from dense_vs.kernels.masks.region_sums import BOTTOM, LEFT, RIGHT, TOP
from dense_vs.segmentation import assess_mask
from dense_vs.segmentation.mask_features import connected_regions, mask_overlap, mask_sums


def blobs(seed, shape=(97, 131)):
    noise = np.random.default_rng(seed).normal(size=shape)
    return cv2.GaussianBlur(noise, (0, 0), 4) > 0.06


@pytest.mark.parametrize("shape", [(97, 131), (24, 64), (5, 3)])
def test_sums_are_those_of_numpy(shape):
    for mask in (blobs(0, shape), np.zeros(shape, bool), np.ones(shape, bool)):
        found = mask_sums(mask)
        y, x = (axis.astype(np.float64) for axis in np.nonzero(mask))
        assert found.area == len(x)
        if not len(x):
            assert np.isnan(found.centroid).all()
            assert found.box.tolist() == [0, 0, 0, 0]
            continue
        np.testing.assert_allclose(found.centroid, [x.mean(), y.mean()], rtol=1e-12)
        covariance = np.mean((x - x.mean()) * (y - y.mean()))
        np.testing.assert_allclose(found.moments, [x.var(), y.var(), covariance], rtol=1e-9, atol=1e-9)
        assert found.box.tolist() == [x.min(), y.min(), np.ptp(x) + 1, np.ptp(y) + 1]
        sides = [(LEFT, mask[:, 0]), (RIGHT, mask[:, -1]), (TOP, mask[0]), (BOTTOM, mask[-1])]
        assert found.border == sum(bit for bit, side in sides if side.any())


@pytest.mark.parametrize("seed", range(4))
def test_regions_are_those_of_opencv(seed):
    mask = blobs(seed)
    count, _, stats, centroids = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    labels, found = connected_regions(mask)
    assert len(found.area) == count - 1 > 2
    np.testing.assert_array_equal(found.area, stats[1:, cv2.CC_STAT_AREA])
    np.testing.assert_array_equal(found.box, stats[1:, :4])
    np.testing.assert_allclose(found.centroid, centroids[1:], rtol=1e-12)
    np.testing.assert_array_equal(labels > 0, mask)


def test_mask_without_a_region():
    labels, found = connected_regions(np.zeros((20, 30), bool))
    assert not labels.any()
    assert found.area.shape == (0,)


def test_more_regions_than_labels_so_far():
    mask = np.zeros((64, 64), bool)
    mask[::2, ::2] = True
    _, found = connected_regions(mask)
    np.testing.assert_array_equal(found.area, np.ones(1024))


def test_overlap_is_that_of_numpy():
    mask, candidates = blobs(0), np.stack([blobs(1), blobs(0), np.zeros((97, 131), bool)])
    found = mask_overlap(mask, candidates)
    np.testing.assert_array_equal(found.intersection, (mask & candidates).sum(axis=(1, 2)))
    np.testing.assert_array_equal(found.union, (mask | candidates).sum(axis=(1, 2)))
    assert found.jaccard[1] == 1.0
    assert found.jaccard[2] == 0.0


def test_threads_do_not_share_buffers():
    masks = [blobs(seed) for seed in range(8)]
    expected = [assess_mask(mask, masks[0]) for mask in masks]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(5):
            assert list(pool.map(lambda mask: assess_mask(mask, masks[0]), masks)) == expected


def test_quality_keeps_box_border_and_share_of_the_border():
    mask = np.zeros((60, 80), bool)
    mask[0:30, 70:80] = True
    quality = assess_mask(mask)
    assert quality.box == (70, 0, 10, 30)
    assert quality.border == RIGHT | TOP
    assert quality.border_share == pytest.approx((10 + 29) / (2 * (60 + 80) - 4))
    assert quality.centroid == (74.5, 14.5)
