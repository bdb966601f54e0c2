"""J at points (16) and the flow that J predicts (1), against interpolation and products in float64."""

import numpy as np
import pytest
from reference_filters import model_flow
from reference_sampling import bilinear

from dense_vs import DenseJacobian, DenseVSError

HEIGHT, WIDTH = 11, 14
# Of the largest |J|: weights and sums of four in float32.
TOLERANCE = 1e-6


@pytest.fixture(scope="module", params=[("shared", 2), ("shared", 1), ("diagonal", 1)], ids=str)
def estimator(request):
    form, order = request.param
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=4, covariance=form, order=order, device="cpu")
    rng = np.random.default_rng(0)
    for _ in range(3):
        estimator.update(rng.normal(0, 1, (HEIGHT, WIDTH, 2)).astype(np.float32), rng.normal(0, 0.03, 4))
    return estimator


def assert_close(got, expected, largest):
    assert got.shape == expected.shape
    assert np.abs(got - expected).max() <= TOLERANCE * largest


POINTS = {
    "inside": np.random.default_rng(1).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (40, 2)),
    "on pixels": np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 2).astype(float),
    "at the border": np.array([[0, 0], [WIDTH - 1, HEIGHT - 1], [WIDTH - 1.25, 3], [4.5, HEIGHT - 1], [0, 2.75]]),
    "just outside": np.array([[-0.25, 3], [WIDTH - 0.75, 3.5], [2.5, -0.75], [5, HEIGHT - 0.1]]),
    "far outside": np.array([[-900, 1e9], [1e6, -1e6], [-1e30, 4.5], [3.25, 700]]),
    "none": np.zeros((0, 2)),
}


@pytest.mark.parametrize("places", POINTS)
def test_points(estimator, places):
    points = POINTS[places]
    J = np.array(estimator.jacobian)
    expected = bilinear(J, points[:, 0], points[:, 1])
    got = estimator.at(points)
    assert got.dtype == np.float32
    if len(points):
        assert_close(got, expected, np.abs(J).max())
    else:
        assert got.shape == (0, 2, 4)


def test_one_point_and_whole_numbers_are_welcome(estimator):
    expected = np.array(estimator.jacobian)[5, 3]
    for point in ([3, 5], (3.0, 5.0), np.array([3, 5]), [[3, 5]]):
        # Not bit-equal in order 2: the two sum the Hessian's part in code that a compiler may contract differently.
        np.testing.assert_allclose(estimator.at(point), expected[None], rtol=1e-6)


def test_result_is_a_copy(estimator):
    before = np.array(estimator.jacobian)
    estimator.at([[3, 5]])[...] = np.nan
    estimator.predicted_flow(np.ones(4))[...] = np.nan
    np.testing.assert_array_equal(estimator.jacobian, before)


@pytest.mark.parametrize("points", [[1.0], [1, 2, 3], [[1, 2, 3]], [[np.nan, 1]], [[1, np.inf]], "tip", [[1], [1, 2]],
                                    None, np.zeros((1, 1, 2))])  # fmt: skip
def test_refuses_points(estimator, points):
    with pytest.raises(DenseVSError, match=r"points .*expected finite image points of shape \(K, 2\)"):
        estimator.at(points)


@pytest.mark.parametrize("depth", ["x", 1, 0.0, None])
def test_refuses_what_is_no_wish_for_depth(estimator, depth):
    with pytest.raises(DenseVSError, match=r"depth is .*; expected True or False"):
        estimator.at([[3, 5]], depth=depth)


def test_several_worlds_refuse_points_without_the_leading_axis():
    estimator = DenseJacobian(height=HEIGHT, width=WIDTH, joints=4, worlds=3, device="cpu")
    for points in (np.zeros((5, 2)), np.zeros((2, 5, 2)), np.full((3, 5, 2), np.nan)):
        with pytest.raises(DenseVSError, match=r"points .*expected .*shape \(3, any, 2\)"):
            estimator.at(points)


@pytest.mark.parametrize("dq", [np.array([0.1, -0.2, 0.3, 1.5]), np.eye(4)[2], np.zeros(4)], ids=str)
def test_predicted_flow(estimator, dq):
    J = np.array(estimator.jacobian, dtype=np.float64)
    expected = model_flow(J, dq.astype(np.float32).astype(float))
    assert_close(estimator.predicted_flow(dq), expected, np.abs(J).max())
    assert estimator.predicted_flow(dq).dtype == np.float32
