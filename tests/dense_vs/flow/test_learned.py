"""What the network adds: motion of plain surfaces, a still background, and how far off it expects to be."""

import sys

import cv2
import numpy as np
import pytest

pytest.importorskip("onnxruntime")

from dense_vs import DenseVSError, FlowEstimator
from dense_vs.flow.estimator import LEARNED

MOTION = np.array([2.0, -1.0])


def plain_disc(height, width, noise=0.0):
    """A plain disc that moves before a still textured wall: both images, and the disc's inside."""
    rng = np.random.default_rng(4)
    wall = cv2.GaussianBlur(rng.normal(size=(4 * height, 4 * width)).astype(np.float32), (0, 0), 8)
    wall = 110 + 20 * wall / wall.std()
    images = []
    for step in (-1.0, 0.0):
        canvas = wall.copy()
        center = 4 * (np.array([width, height]) / 2 + step * MOTION)
        cv2.circle(canvas, tuple(int(c) for c in center), 4 * 36, 205.0, -1)
        image = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
        images.append((image + noise * rng.normal(size=image.shape)).clip(0, 255).round().astype(np.uint8))
    y, x = np.indices((height, width))
    distance = np.hypot(x - width / 2, y - height / 2)
    return *images, distance < 32, distance > 44


@pytest.mark.parametrize(("size", "noise"), [((240, 320), 0.0), ((240, 320), 3.0), ((480, 640), 0.0)], ids=str)
@pytest.mark.parametrize("method", LEARNED)
def test_a_plain_surface_moves_as_its_outline_does(method, size, noise):
    previous, present, inside, outside = plain_disc(*size, noise)
    learned, classical = (FlowEstimator(name, *size)(previous, present) for name in (method, "dis"))
    errors = [np.linalg.norm(u - MOTION, axis=2)[inside].mean() for u in (learned, classical)]
    assert errors[0] < 0.6 * errors[1]
    assert np.linalg.norm(learned, axis=2)[outside].mean() < 0.1


def test_nothing_moves_where_nothing_changes():
    _, present, *_ = plain_disc(240, 320, noise=3.0)
    u = FlowEstimator("learned")(present, present)
    assert np.abs(u).max() < 0.1


def test_expected_error_is_larger_where_the_error_is():
    estimator = FlowEstimator("learned")
    assert estimator.expected_error is None
    previous, present, inside, outside = plain_disc(240, 320, noise=2.0)
    u = estimator(previous, present)
    expected = estimator.expected_error
    assert (expected.shape, expected.dtype) == ((240, 320), np.float32)
    assert (expected > 0).all()
    error = np.linalg.norm(u - MOTION * inside[..., None], axis=2)
    assert expected[inside].mean() > 3 * expected[outside].mean()
    assert 1 / 4 < expected[inside].mean() / error[inside].mean() < 4
    assert FlowEstimator("dis").expected_error is None


def test_it_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(DenseVSError, match=r"onnxruntime.*dense-vs\[vos\]"):
        FlowEstimator("learned")
