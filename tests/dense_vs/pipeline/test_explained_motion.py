"""E against its definition, computed pixel by pixel in float64, and its shares over time by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.pipeline import ExplainedMotion
from dense_vs.pipeline.explained_motion import MotionSums, _check_image, share_of_pixels_known


def reference(flow, J, dq):
    """1 - sum |u - J(y) dq|^2 / sum |u|^2 with y = x - J(y) dq by three rounds, nearest pixels."""
    height, width = flow.shape[:2]
    residual = energy = 0.0
    for row in range(height):
        for column in range(width):
            u = flow[row, column].astype(float)
            if np.hypot(*u) <= 0.7:
                continue
            y, x = row, column
            for k in range(3):
                predicted = J[y, x].astype(float) @ dq
                if k < 2:
                    x = int(np.clip(np.rint(column - predicted[0]), 0, width - 1))
                    y = int(np.clip(np.rint(row - predicted[1]), 0, height - 1))
            residual += np.sum((u - predicted) ** 2)
            energy += np.sum(u**2)
    return 1 - residual / energy


@pytest.fixture
def frame():
    random = np.random.default_rng(0)
    J = random.normal(0, 20, (30, 40, 2, 3)).astype(np.float32)
    dq = np.array([0.05, -0.02, 0.03])
    flow = (J @ dq + random.normal(0, 0.5, (30, 40, 2))).astype(np.float32)
    flow[:5] = 0
    return flow, J, dq


def test_one_frame(frame):
    flow, J, dq = frame
    explained = ExplainedMotion(3)
    explained.observe(0.0, flow, J, dq)
    assert explained.explained() == pytest.approx(reference(flow, J, dq), abs=1e-9)
    assert explained.by_joint().sum() == pytest.approx(explained.explained())


def test_exact_and_worthless_and_unlearned(frame):
    flow, J, dq = frame
    exact = ExplainedMotion(3)
    even = np.broadcast_to(np.array([[1.0, 2.0, 0.0], [0.5, 0.0, 1.0]], np.float32), J.shape) * 30
    exact.observe(0.0, (even @ dq).astype(np.float32), even, dq)
    assert exact.explained() == pytest.approx(1.0)
    nothing = ExplainedMotion(3)
    nothing.observe(0.0, flow, np.zeros_like(J), dq)
    assert nothing.explained() == 0
    unlearned = ExplainedMotion(3)
    missing = even.copy()
    missing[..., 2] = np.nan  # a column that is not learned counts as zero
    unlearned.observe(0.0, (even @ dq).astype(np.float32), missing, dq)
    assert 0 < unlearned.explained() < 1
    assert unlearned.by_joint()[2] == 0
    still = ExplainedMotion(3)
    still.observe(0.0, np.zeros_like(flow), J, dq)
    assert np.isnan(still.explained())


def test_quarters_and_bounded_memory(frame):
    flow, J, dq = frame
    explained = ExplainedMotion(3)
    zero = np.zeros_like(J[:8, :8])
    part = flow[10:18, :8]
    for k in range(10_000):
        good = k >= 7500
        explained.observe(float(k), (J[:8, :8] @ dq).astype(np.float32) if good else part, J[:8, :8] * good + zero, dq)
    assert len(explained.spans) <= 4096
    quarters = explained.quarters()
    np.testing.assert_allclose(quarters[:3], 0, atol=0.01)
    assert quarters[3] != pytest.approx(0, abs=0.01)
    assert explained.settled() == pytest.approx(explained.explained(2499.75), abs=0.01)


def test_refuses_what_is_no_motion(frame):
    flow, J, dq = frame
    for joints in (0, -1, 1.5, "x", None, 2j):
        with pytest.raises(DenseVSError, match=r"joints is .*; expected a whole number"):
            ExplainedMotion(joints)
    explained = ExplainedMotion(3)
    good = {"time": 0.0, "flow": flow, "jacobian": J, "dq": dq}
    wrong = {
        "time": ["x", np.nan, 1j, True, None, 10**400],
        "flow": ["x", None, flow[..., 0], flow[:0], flow.astype(int), flow.tolist(), flow[:-1]],
        "jacobian": ["x", None, J[..., 0], J[..., :2], J[:-1], J.astype(complex), [[1.0], [1.0, 2.0]]],
        "dq": ["x", None, dq[:2], 1.0, ["1", "2", "3"], dq * 1j, [[1.0], [1.0, 2.0]]],
    }
    infinite, hidden = np.float64([1e300, np.inf, -np.inf]), np.ma.masked_array(J, mask=J > 9.0)
    wrong["flow"] += [flow * infinite[0]]
    wrong["jacobian"] += [*(J * one for one in infinite), hidden]
    wrong["dq"] += [*(dq * one for one in infinite[1:]), dq * 1e300 * 1e9]
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(DenseVSError, match="expected"):
                explained.observe(**good | {name: value})
    with pytest.raises(DenseVSError, match=r"^flow has shape .* of shape \(any, any, 2\)$"):
        explained.observe(**good | {"flow": flow[..., 0]})
    assert np.isnan(explained.explained())
    explained.observe(**good)
    for bound in ("x", 1j, None, True, [1.0]):
        with pytest.raises(DenseVSError, match=r"begin .*expected"):
            explained.explained(bound)
    assert np.isfinite(explained.explained(-np.inf, np.inf))


def spans(*ones):
    explained = ExplainedMotion(2)
    for time, energy, *parts in ones:
        explained._add(MotionSums(time, energy, np.array(parts, float)))
    return explained


def test_shares_lie_between_times():
    explained = spans((1.0, 10.0, 4.0, 2.0), (2.0, 0.0, 0.0, 0.0), (3.0, 30.0, 9.0, -3.0), (5.0, 10.0, 10.0, 0.0))
    assert explained.explained() == pytest.approx(22 / 50)
    np.testing.assert_allclose(explained.by_joint(), [23 / 50, -1 / 50])
    assert explained.explained(1.0, 3.0) == pytest.approx(6 / 30)  # after the first time, up to the second
    assert explained.explained(0.9, 2.9) == pytest.approx(0.6)
    assert np.isnan(explained.explained(1.0, 2.0))
    times, shares = explained.over_time()
    np.testing.assert_allclose(times, [1.0, 3.0, 5.0])
    np.testing.assert_allclose(shares, [0.6, 0.2, 1.0])
    assert explained.settled() == pytest.approx(16 / 40)  # after 1 + a quarter of 4 s
    first, second, third, fourth = explained.quarters()
    assert first == pytest.approx(0.6)
    assert (second, fourth) == pytest.approx((0.2, 1.0))
    assert np.isnan(third)
    nothing = ExplainedMotion(2)
    assert np.isnan([nothing.settled(), *nothing.quarters(), nothing.explained()]).all()
    assert nothing.over_time()[0].size == 0


@pytest.mark.parametrize(("width", "stride"), [(40, 1), (239, 1), (240, 2), (399, 2), (401, 3)])
def test_about_160_columns_of_pixels_are_looked_at(width, stride):
    flow, J = np.full((7, width, 2), 9.0), np.zeros((7, width, 2, 1))
    flow[::stride, ::stride] = [3.0, 0.0]
    J[..., 0, 0] = 4.0
    explained = ExplainedMotion(1)
    explained.observe(1.0, flow, J, np.array([0.5]))
    assert explained.explained() == pytest.approx(1 - 1 / 9)
    assert explained.spans[0].energy == pytest.approx(9.0 * len(range(0, 7, stride)) * len(range(0, width, stride)))


def test_two_spans_become_one_when_there_are_4096():
    explained = spans(*((float(k), 1.0, 0.5, 0.0) for k in range(4095)))
    assert len(explained.spans) == 4095
    explained._add(MotionSums(4095.0, 1.0, np.array([0.5, 0.0])))
    assert len(explained.spans) == 2048


def test_long_recordings_join_their_spans(monkeypatch):
    monkeypatch.setattr("dense_vs.pipeline.explained_motion.MOST_SPANS", 4)
    explained = spans(*((float(k), 1.0, k / 10, 0.0) for k in range(9)))
    assert len(explained.spans) < 4
    assert explained.explained() == pytest.approx(sum(range(9)) / 90)
    assert explained.over_time()[0][-1] == 8.0


def test_pixels_are_known_that_a_usual_step_moves_by_a_tenth():
    J = np.zeros((1, 5, 2, 2))
    J[0, 0, 0, 0] = 9.9  # 0.099 px by the first joint's step
    J[0, 1, 0, 0] = 10.1
    J[0, 2, :, 1] = [3.6, 4.8]  # 0.12 px by the second's
    J[0, 3] = [[9.0, 4.0], [0.0, 0.0]]  # together they would, each by itself not
    J[0, 4, 0, 0] = np.nan
    estimator = SimpleNamespace(to_numpy=lambda: J)
    assert share_of_pixels_known(estimator, np.array([0.01, 0.02])) == pytest.approx(0.4)


def test_a_pixel_that_moves_by_just_the_limit_is_not_known(monkeypatch):
    monkeypatch.setattr("dense_vs.pipeline.explained_motion.KNOWN", 0.25)
    J = np.array([0.25, 0.5, 0.0, 0.25])[None, :, None, None] * np.array([[1.0], [0.0]])
    assert share_of_pixels_known(SimpleNamespace(to_numpy=lambda: J), np.array([1.0])) == 0.25
    assert share_of_pixels_known(SimpleNamespace(to_numpy=lambda: J), np.array([2.0])) == 0.75


@pytest.mark.parametrize(
    "wrong", [np.zeros((3, 4)), np.zeros((3, 4, 3)), np.zeros((3, 4, 2), int), np.zeros((0, 4, 2)), [1]]
)
def test_an_image_of_another_shape_is_told_what_is_expected(wrong):
    with pytest.raises(DenseVSError, match=r"^flow .*; expected floating-point numbers of shape \(any, any, 2\)$"):
        _check_image("flow", wrong, (-1, -1, 2))
    assert _check_image("flow", np.zeros((3, 4, 2)), (-1, -1, 2)).shape == (3, 4, 2)
