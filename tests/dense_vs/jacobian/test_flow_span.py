"""Flow that spans more than a frame, and frames without flow, against the float64 filter."""

import numpy as np
import pytest
from reference_filters import ReferenceJacobian

from dense_vs import DenseJacobian
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.filter import JacobianFilter

HEIGHT, WIDTH, JOINTS = 12, 17, 3
SIZE = {"height": HEIGHT, "width": WIDTH, "joints": JOINTS}
# float32 against float64 over nine frames
CLOSE = {"rtol": 2e-3, "atol": 0.05}


def frames(order_of_spans):
    """Steps, and the flow and span at the end of each group of them; flow of smooth random Jacobians of that size."""
    rng = np.random.default_rng(3)
    J = rng.normal(0, 60, (2, JOINTS)) + rng.normal(0, 2, (HEIGHT, WIDTH, 2, JOINTS))
    for count in order_of_spans:
        steps = rng.normal(0, 0.02, (count, JOINTS))
        span = steps.sum(axis=0)
        yield steps, (J @ span).astype(np.float32), span


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("layout", ["matrices", "planes"])
def test_span_agrees_with_the_reference(order, layout):
    estimator = DenseJacobian(**SIZE, order=order, device="cpu", threads=2)
    estimator.filter = JacobianFilter(estimator.options, estimator.device, 2, layout=layout, spans=True)
    reference = ReferenceJacobian(estimator.options)
    for steps, flow, span in frames([1, 3, 2, 1, 4]):
        for dq in steps[:-1]:
            estimator.predict(dq)
            reference.update(np.zeros_like(flow), dq, np.zeros(JOINTS))
        estimator.update(flow, steps[-1], span)
        reference.update(flow, steps[-1], span)
    stored = estimator.filter.stored()
    moved = reference.state.copy()
    if order == 2:  # the image holds the state at the posture it began with
        moved = reference.state @ np.linalg.inv(reference.second.transition(stored["displacement"][0])).T
    np.testing.assert_allclose(stored["state"][0], moved, **CLOSE)
    np.testing.assert_allclose(estimator.covariance, reference.P[:JOINTS, :JOINTS], rtol=1e-4)


def test_a_span_of_one_frame_is_an_update():
    one, other = (DenseJacobian(**SIZE, device="cpu") for _ in range(2))
    for steps, flow, span in frames([1, 1, 1]):
        one.update(flow, steps[0])
        other.update(flow, steps[0], span)
    np.testing.assert_array_equal(one.jacobian, other.jacobian)


def test_long_spans_find_a_constant_jacobian():
    J = np.random.default_rng(0).normal(0, 100, (HEIGHT, WIDTH, 2, JOINTS))
    estimator = DenseJacobian(**SIZE, order=1, prediction="none", measurement_noise=1e-4, device="cpu")
    rng = np.random.default_rng(1)
    for _ in range(200):
        steps = rng.normal(0, 0.03, (3, JOINTS))
        for dq in steps[:-1]:
            estimator.predict(dq)
        estimator.update((J @ steps.sum(axis=0)).astype(np.float32), steps[-1], steps.sum(axis=0))
    relative = np.linalg.norm(estimator.jacobian - J, axis=(2, 3)) / np.linalg.norm(J, axis=(2, 3))
    assert np.median(relative) < 1e-3


@pytest.mark.parametrize("options", [{"covariance": "diagonal"}, {"covariance": "fixed"}, {"prediction": "flow"}])
def test_spans_need_a_shared_covariance_and_the_model(options):
    estimator = DenseJacobian(**SIZE, order=1, device="cpu", **options)
    flow, dq = np.zeros((HEIGHT, WIDTH, 2), np.float32), np.full(JOINTS, 0.01)
    assert not estimator.takes_spans
    with pytest.raises(DenseVSError, match="spans"):
        estimator.predict(dq)
    with pytest.raises(DenseVSError, match="spans"):
        estimator.update(flow, dq, 2 * dq)
    assert estimator.updates == 0


@pytest.mark.parametrize("span", [[0.1, 0.2], [0.1, 0.2, np.nan], "far"])
def test_a_bad_span_leaves_the_estimate(span):
    estimator = DenseJacobian(**SIZE, device="cpu")
    with pytest.raises(DenseVSError, match="span"):
        estimator.update(np.ones((HEIGHT, WIDTH, 2), np.float32), np.full(JOINTS, 0.01), span)
    assert estimator.updates == 0
    assert not estimator.jacobian.any()
