"""The flow's convention, x - u(x) is the old place, for every method on images that moved by a known amount."""

import numpy as np
import pytest
from planar_scene import SHIFT
from reference_sampling import bilinear

from dense_vs import DenseVSError, FlowEstimator
from dense_vs.flow.estimator import METHODS, to_gray

# Median error [px] away from the border; OpenCV's ultrafast preset stops at a coarser scale.
TOLERANCE = {method: 0.1 for method in METHODS} | {"dis-medium": 0.2, "dis-ultrafast": 0.5}
INNER = (slice(16, -16), slice(16, -16))


@pytest.mark.parametrize("shift", [(1.3, -0.6), (-2.5, 1.75), (0.0, 0.0)], ids=str)
@pytest.mark.parametrize("method", METHODS)
def test_points_from_the_old_place_to_the_new(scene, method, shift):
    still = np.zeros(4)
    moved = np.array([*shift, 0, 0]) / SHIFT
    previous, present = scene.image(still), scene.image(moved)
    u = FlowEstimator(method, scene.height, scene.width)(previous, present)
    assert (u.shape, u.dtype) == ((scene.height, scene.width, 2), np.float32)
    assert np.median(np.linalg.norm(u - shift, axis=2)[INNER]) < TOLERANCE[method]
    old = bilinear(previous, *np.moveaxis(scene.pixels - u, -1, 0))
    assert np.median(np.abs(old - present)[INNER]) <= 6 * TOLERANCE[method] + 1


@pytest.mark.parametrize("method", ["lucas-kanade", "dis", "farneback"])
def test_flow_of_a_turning_plane(scene, method):
    before, after = np.array([0.0, 0, -0.02, 0.01]), np.array([0.01, -0.01, 0.02, -0.02])
    u = FlowEstimator(method, scene.height, scene.width)(scene.image(before), scene.image(after))
    error = np.linalg.norm(u - scene.flow(before, after), axis=2)[INNER]
    assert np.median(error) < TOLERANCE[method]


@pytest.mark.parametrize("method", METHODS)
def test_smallest_and_odd_sizes(method):
    rng = np.random.default_rng(0)
    for height, width in ((16, 16), (17, 61), (45, 16)):
        image = rng.integers(0, 256, (height, width), dtype=np.uint8)
        u = FlowEstimator(method, height, width)(image, image)
        assert u.shape == (height, width, 2)
        assert np.isfinite(u).all()


def test_results_are_independent_and_inputs_are_left_alone(scene):
    images = [scene.image(q) for q in (np.zeros(4), np.array([0.02, 0, 0, 0]), np.array([0.02, 0.03, 0, 0]))]
    copies = [image.copy() for image in images]
    estimator = FlowEstimator("dis", scene.height, scene.width)
    first = estimator(images[0], images[1])
    kept = first.copy()
    estimator(images[1], images[2])
    np.testing.assert_array_equal(first, kept)
    for image, copy in zip(images, copies, strict=True):
        np.testing.assert_array_equal(image, copy)
    strided = [np.repeat(image, 2, axis=1)[:, ::2] for image in images[:2]]
    np.testing.assert_array_equal(estimator(*strided), first)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("raft", 32, 32), "flow method 'raft' is unknown; expected one of lucas-kanade, dis, "),
        ((None, 32, 32), "flow method None is unknown"),
        ((["dis"], 32, 32), "is unknown; expected one of"),
        (("x" * 999, 32, 32), r"'x{299}\.\.\. is unknown; expected one of"),
        (("dis", 15, 32), "height is 15; expected a whole number of at least 16"),
        (("dis", 32, 32.0), "width is 32.0; expected a whole number"),
    ],
)
def test_refuses_a_method_or_size(arguments, message):
    with pytest.raises(DenseVSError, match=message):
        FlowEstimator(*arguments)


def test_refuses_images():
    estimator = FlowEstimator("dis", 20, 30)
    good = np.zeros((20, 30), np.uint8)
    for bad in (np.zeros((30, 20), np.uint8), np.zeros((20, 30, 3), np.uint8), np.zeros((20, 30), np.float32), None):
        with pytest.raises(DenseVSError, match=r"^gray has .*expected uint8 of shape \(20, 30\)"):
            estimator(good, bad)
        with pytest.raises(DenseVSError, match=r"^previous_gray has .*expected uint8 of shape \(20, 30\)"):
            estimator(bad, good)


def test_to_gray():
    rgb = np.random.default_rng(0).integers(0, 256, (6, 7, 3), dtype=np.uint8)
    luma = rgb @ np.array([0.299, 0.587, 0.114])
    assert np.abs(to_gray(rgb) - luma).max() <= 1
    np.testing.assert_array_equal(to_gray(rgb[..., 0]), rgb[..., 0])
    for bad in (rgb.astype(float), rgb[..., :2], np.zeros((6, 7, 4), np.uint8), np.zeros(5, np.uint8), None):
        with pytest.raises(DenseVSError, match=r"image has .*expected uint8 of shape \(H, W, 3\) or \(H, W\)"):
            to_gray(bad)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"threads": "x"}, "threads is 'x'; expected a whole"), ({"device": "gpu"}, "device 'gpu' is not present")],
)
def test_what_a_method_does_not_use_is_checked_too(options, message):
    with pytest.raises(DenseVSError, match=message):
        FlowEstimator("dis", 32, 32, **options)
