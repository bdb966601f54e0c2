"""Depth by a body model: its derivatives against finite differences, and its scale from noisy depth images."""

from dataclasses import replace

import numpy as np
import pytest

from dense_vs.body_model import BodyModel
from dense_vs.body_model.chain import Chain
from dense_vs.body_model.model_file import ModelContent
from dense_vs.body_model.precision import Precision
from dense_vs.body_model.surface import Surface
from dense_vs.errors import DenseVSError

SIZE, JOINTS = (60, 80), 2
Q = np.array([0.2, -0.15])


@pytest.fixture(scope="module")
def model():
    """A plate of two links before the camera, dense enough to cover its pixels, in a unit of 0.4 m."""
    y, x = (part.ravel() for part in np.mgrid[-0.5:0.5:160j, -0.8:0.8:240j])
    points = np.stack([x, y, 2.5 + 0.3 * x], axis=1)
    axes = np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    chain = Chain(axes, np.array([[-0.9, 0.0, 2.2], [0.1, 0.2, 2.5]]), np.zeros(JOINTS), np.array([-1, 0]))
    surface = Surface(points, (x > 0).astype(int), np.ones(len(x)), np.zeros(len(x), np.uint8))
    ends = np.array([[-1.0, 1.0]] * JOINTS)
    return BodyModel(ModelContent(chain, 90.0, (39.5, 29.5), SIZE, surface, np.ones(JOINTS, bool), ends, 0.1))


def depths(model, q):
    """Of every point of the surface."""
    return model.points(q).depths


def test_the_row_of_depth_is_the_derivative_of_depth(model):
    D, index = model.depth_jacobian(Q), model.image(Q).points
    body = index >= 0
    assert D.shape == (*SIZE, JOINTS)
    assert body.sum() > 500
    assert not D[~body].any()
    for n, step in enumerate(1e-5 * np.eye(JOINTS)):
        slope = (depths(model, Q + step) - depths(model, Q - step)) / 2e-5
        np.testing.assert_allclose(D[body][:, n], slope[index[body]], atol=1e-5)
    assert np.abs(D[..., 0]).max() > 0.3
    assert not D[model.image(Q).links == 0][:, 1].any()


def measured(model, q, rng, meters=0.4):
    """A depth image of the body before a wall: noise, holes, and a share that is far off."""
    exact = np.where(np.isfinite(model.image(q).depths), meters * model.image(q).depths, 1.7)
    noisy = exact + 0.01 * rng.standard_normal(SIZE)
    noisy = np.where(rng.random(SIZE) < 0.1, exact + 0.5, noisy)
    return np.where(rng.random(SIZE) < 0.2, (0.0, np.nan)[rng.integers(2)], noisy)


def test_some_noisy_depth_images_give_the_scale(model):
    rng = np.random.default_rng(0)
    postures = rng.uniform(-0.3, 0.3, (4, JOINTS))
    metric = model.in_meters([measured(model, q, rng) for q in postures], postures)
    np.testing.assert_allclose(depths(metric, Q), 0.4 * depths(model, Q), rtol=3e-3)
    np.testing.assert_allclose(metric.depth_jacobian(Q), 0.4 * model.depth_jacobian(Q), atol=2e-3)
    np.testing.assert_allclose(metric.jacobian(Q), model.jacobian(Q), atol=1e-3)
    np.testing.assert_allclose(metric.flow(Q, [0.02, 0.03]), model.flow(Q, [0.02, 0.03]), atol=1e-4)
    assert metric.focal_length == model.focal_length


@pytest.mark.parametrize("slide", [False, True])
def test_a_model_in_meters_is_as_well_known_in_pixels(model, slide):
    rng = np.random.default_rng(3)
    content = model._content()
    count = len(content.surface.links)
    precision = Precision(
        0.01 * rng.standard_normal((5, 4 * JOINTS + 1)), 0.01 * rng.standard_normal((count, 5)), np.full(count, 0.01),
        np.array([[0.1, 0.3]]), np.zeros(count, int), 0.4,
    )  # fmt: skip
    points = (
        content.chain.points - np.sum(content.chain.points * content.chain.axes, axis=1)[:, None] * content.chain.axes
    )
    chain = replace(content.chain, points=points)
    if slide:
        axes, travel = chain.axes.copy(), np.zeros((JOINTS, 3))
        axes[1], travel[1] = 0.0, [0.3, 0.1, 0.2]
        chain = replace(chain, axes=axes, travel=travel)
    known = BodyModel(replace(content, precision=precision, chain=chain))
    metric = known.in_meters([np.where(np.isfinite(known.image(Q).depths), 0.4 * known.image(Q).depths, 0)], Q[None])
    q = np.array([-0.4, 0.5])
    expected = known.points(q).covariances
    np.testing.assert_allclose(metric.points(q).covariances, expected, rtol=1e-3, atol=1e-4)
    unscaled = BodyModel(replace(metric._content(), precision=precision)).points(q).covariances
    assert np.median(np.abs(unscaled / expected - 1)) > 0.05


def test_refuses_what_tells_no_scale(model):
    rng = np.random.default_rng(1)
    good = measured(model, Q, rng)
    for images, said in (
        ([np.zeros(SIZE)], "depth is known at 0 pixels of the body"),
        ([np.full(SIZE, np.nan)], "depth is known at 0 pixels of the body"),
        ([good[1:]], "depth has shape"),
        ([(1000 * np.nan_to_num(good)).astype(np.uint16)], "dtype uint16"),
        ([good, good], "joints has shape"),
    ):
        with pytest.raises(DenseVSError, match=said):
            model.in_meters(images, Q[None])
