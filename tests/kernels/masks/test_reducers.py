"""Masks and labelled images reduced in one pass, against NumPy in float64 and against OpenCV."""

import cv2
import numpy as np
import pytest
import warp as wp

from dense_vs.kernels.masks.mask_overlap import OverlapReducer
from dense_vs.kernels.masks.reducers import BOTTOM, LEFT, RIGHT, TOP, LabelReducer, MaskReducer

# A row of whole words, one that is not, one shorter than a word; several worlds.
SHAPES = [(2, 24, 64), (3, 37, 53), (1, 5, 3)]
FILLS = [0.0, 0.01, 0.5, 1.0]
devices = pytest.mark.parametrize(
    "device",
    [
        "cpu",
        pytest.param(
            "cuda:0",
            marks=[pytest.mark.gpu, pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")],
        ),
    ],
)


def random_masks(shape, fill, seed=0):
    """Masks whose set pixels have any value but 0."""
    rng = np.random.default_rng(seed)
    return ((rng.random(shape) < fill) * rng.integers(1, 256, shape)).astype(np.uint8)


def blobs(shape, seed=1):
    """Binary masks of regions of some size, as a segmenter makes them."""
    noise = np.random.default_rng(seed).normal(size=shape)
    return np.stack([(cv2.GaussianBlur(image, (0, 0), 3) > 0.05).astype(np.uint8) for image in noise])


def assert_region(found, index, selected):
    ys, xs = np.nonzero(selected)
    assert found.area[index] == len(xs)
    if not len(xs):
        assert np.isnan(found.centroid[index]).all()
        assert np.isnan(found.moments[index]).all()
        assert found.box[index].tolist() == [0, 0, 0, 0]
        assert found.border[index] == 0
        return
    np.testing.assert_allclose(found.centroid[index], [xs.mean(), ys.mean()], rtol=1e-12)
    covariance = np.mean((xs - xs.mean()) * (ys - ys.mean()))
    np.testing.assert_allclose(found.moments[index], [xs.var(), ys.var(), covariance], rtol=1e-9, atol=1e-9)
    assert found.box[index].tolist() == [xs.min(), ys.min(), np.ptp(xs) + 1, np.ptp(ys) + 1]
    sides = [(LEFT, selected[:, 0]), (RIGHT, selected[:, -1]), (TOP, selected[0]), (BOTTOM, selected[-1])]
    assert found.border[index] == sum(bit for bit, side in sides if side.any())


@devices
@pytest.mark.parametrize("shape", SHAPES)
def test_masks_against_numpy(shape, device):
    reduce = MaskReducer(*shape, device, threads=2)
    for fill in FILLS:
        masks = random_masks(shape, fill)
        found = reduce(masks)
        for world in range(shape[0]):
            assert_region(found, world, masks[world] > 0)


def test_masks_against_opencv():
    masks = blobs((1, 120, 160))
    found = MaskReducer(*masks.shape)(masks)
    m = cv2.moments(masks[0], binaryImage=True)
    assert found.area[0] == m["m00"]
    np.testing.assert_allclose(found.sums[0, 1:], [m["m10"], m["m01"], m["m20"], m["m02"], m["m11"]], rtol=1e-14)
    np.testing.assert_allclose(found.moments[0] * m["m00"], [m["mu20"], m["mu02"], m["mu11"]], rtol=1e-9)


@devices
@pytest.mark.parametrize("shape", SHAPES[:2])
def test_labels_against_opencv(shape, device):
    masks = blobs(shape)
    labelled, stats, centroids = [], [], []
    for mask in masks:
        _, labels, of_labels, of_centroids = cv2.connectedComponentsWithStats(mask)
        labelled.append(labels)
        stats.append(of_labels)
        centroids.append(of_centroids)
    most = max(len(of_labels) for of_labels in stats)
    found = LabelReducer(*shape, most + 1, device, threads=2)(np.stack(labelled))
    for world, (of_labels, of_centroids) in enumerate(zip(stats, centroids, strict=True)):
        present = len(of_labels)
        assert present > 2
        np.testing.assert_array_equal(found.area[world, :present], of_labels[:, cv2.CC_STAT_AREA])
        np.testing.assert_array_equal(found.box[world, :present], of_labels[:, :4])
        np.testing.assert_allclose(found.centroid[world, :present], of_centroids, rtol=1e-12)
        for label in range(most + 1):  # the last is of no region
            found_one = type(found)(found.sums[world], found.box[world], found.border[world])
            assert_region(found_one, label, labelled[world] == label)


def test_labels_out_of_range_are_not_counted():
    labels = np.array([[[5, 0, 1, -1, 1]]], dtype=np.int32)
    found = LabelReducer(1, 1, 5, 2)(labels)
    assert found.area.tolist() == [[1, 2]]
    assert found.box[0, 1].tolist() == [2, 0, 3, 1]


def test_a_split_row_of_one_label_is_one_region():
    labels = np.zeros((1, 4, 300), dtype=np.int32)
    labels[0, 2, ::7] = 1
    found = LabelReducer(1, 4, 300, 2)(labels)
    one = type(found)(found.sums[0], found.box[0], found.border[0])
    assert_region(one, 1, labels[0] == 1)


def test_any_number_of_threads_gives_the_same_sums():
    masks = random_masks((1, 41, 77), 0.3)
    labels = np.random.default_rng(2).integers(0, 5, (1, 41, 77)).astype(np.int32)
    results = [
        (MaskReducer(1, 41, 77, threads=n)(masks), LabelReducer(1, 41, 77, 5, threads=n)(labels)) for n in (1, 2, 3, 64)
    ]
    for of_masks, of_labels in results[1:]:
        for found, first in ((of_masks, results[0][0]), (of_labels, results[0][1])):
            np.testing.assert_array_equal(found.sums, first.sums)
            np.testing.assert_array_equal(found.box, first.box)
            np.testing.assert_array_equal(found.border, first.border)


def test_sums_of_a_large_full_image_are_exact():
    height, width = 2160, 3840
    found = MaskReducer(1, height, width)(np.ones((1, height, width), dtype=np.uint8))
    x, y = range(width), range(height)
    expected = [height * width, height * sum(x), width * sum(y)]
    expected += [height * sum(k * k for k in x), width * sum(k * k for k in y), sum(x) * sum(y)]
    assert found.sums[0].tolist() == expected
    np.testing.assert_allclose(found.moments[0], [(width**2 - 1) / 12, (height**2 - 1) / 12, 0], rtol=1e-15)


@devices
@pytest.mark.parametrize("shape", [*SHAPES, (1, 10, 200)])
def test_overlap_against_numpy(shape, device):
    reduce = OverlapReducer(*shape, 6, device, threads=2)
    candidates = np.stack([random_masks(shape[1:], fill, seed=4) for fill in (0, 0.05, 0.3, 0.6, 0.9, 1)])
    reduce.set_candidates(candidates)
    for fill in FILLS:
        masks = random_masks(shape, fill) > 0
        found = reduce(masks)
        both = masks[:, None] & (candidates > 0)
        either = masks[:, None] | (candidates > 0)
        np.testing.assert_array_equal(found.intersection, both.sum(axis=(2, 3)))
        np.testing.assert_array_equal(found.union, either.sum(axis=(2, 3)))
        expected = [
            [b / e if e else 0.0 for b, e in zip(bs, es, strict=True)]
            for bs, es in zip(both.sum(axis=(2, 3)), either.sum(axis=(2, 3)), strict=True)
        ]
        np.testing.assert_allclose(found.jaccard, expected)


def test_takes_warp_arrays_and_truth_values():
    masks = random_masks((1, 20, 30), 0.4)
    reduce = MaskReducer(1, 20, 30)
    expected = reduce(masks)
    for given in (masks > 0, wp.array(masks, dtype=wp.uint8, device="cpu"), np.asfortranarray(masks)):
        np.testing.assert_array_equal(reduce(given).sums, expected.sums)
    labels = (masks > 0).astype(np.int32)
    of_labels = LabelReducer(1, 20, 30, 2)(wp.array(labels, dtype=wp.int32, device="cpu"))
    np.testing.assert_array_equal(of_labels.sums[:, 1], expected.sums)


@pytest.mark.parametrize("wrong", [np.zeros((1, 20, 31), np.uint8), np.zeros((1, 20, 30), np.float32)])
def test_another_shape_or_type_is_refused(wrong):
    with pytest.raises(ValueError, match=r"expected uint8 \(1, 20, 30\)"):
        MaskReducer(1, 20, 30)(wrong)
    with pytest.raises(ValueError, match=r"expected int32 \(1, 20, 30\)"):
        LabelReducer(1, 20, 30, 4)(wrong)
