"""Several points servoed together: DIJE (17) with their J stacked and weighted, against a least-squares solution."""

import numpy as np
import pytest

from dense_vs import VisualServo
from dense_vs.errors import DenseVSError

GAIN, DAMPING = 0.2, 15.0


@pytest.fixture
def case():
    random = np.random.default_rng(4)
    return random.normal(0, 80, (3, 2, 5)), random.uniform(0, 200, (3, 2)), random.uniform(0, 200, (3, 2))


def servo(**options):
    return VisualServo(5, gain=GAIN, damping=DAMPING, dither=0.0, **{"max_step": 10.0, **options})


def expected(J, points, targets, weights):
    """argmin of sum_k w_k |J_k dq - gain e_k|^2 + damping^2 |dq|^2, the largest weight being 1."""
    root = np.sqrt(np.asarray(weights) / max(weights))
    rows = np.concatenate([r * part for r, part in zip(root, J, strict=True)])
    motion = np.concatenate([r * GAIN * part for r, part in zip(root, targets - points, strict=True)])
    augmented = np.concatenate([rows, DAMPING * np.eye(5)])
    return np.linalg.lstsq(augmented, np.concatenate([motion, np.zeros(5)]), rcond=None)[0]


@pytest.mark.parametrize("weights", [(1, 1, 1), (1, 10, 0.1), (300, 300, 300)])
def test_the_step_is_the_damped_least_squares_solution(case, weights):
    step = servo().together(*case, np.array(weights, float))
    np.testing.assert_allclose(step, expected(*case, weights), rtol=1e-9)


def test_one_point_is_servoed_as_alone(case):
    J, points, targets = case
    alone = servo()(J[0], points[0], targets[0])
    np.testing.assert_allclose(servo().together(J[:1], points[:1], targets[:1], np.array([7.0])), alone, rtol=1e-12)


def test_limits_and_the_largest_step_hold(case):
    limits = np.array([[-0.001, 0.001]] * 5)
    step = servo(joint_limits=limits).together(*case, positions=np.array([0.001, 0, 0, 0, -0.001]))
    assert -0.002 <= step[0] <= 0
    assert 0 <= step[4] <= 0.002
    assert (np.abs(step[1:4]) <= 0.001).all()
    assert np.abs(servo(max_step=0.01).together(*case)).max() <= 0.01 + 1e-12


@pytest.mark.parametrize("weights", [[1, 0, 1], [1, -1, 1], [1, np.nan, 1], [1, 1]])
def test_bad_weights_are_refused(case, weights):
    with pytest.raises(DenseVSError, match="weights"):
        servo().together(*case, np.array(weights, float))


def test_no_point_or_another_shape_is_refused(case):
    J, points, targets = case
    with pytest.raises(DenseVSError, match="weights"):
        servo().together(J[:0], points[:0], targets[:0])
    with pytest.raises(DenseVSError, match="targets"):
        servo().together(J, points, targets[:2])
    with pytest.raises(DenseVSError, match="jacobians"):
        servo().together(J[..., :4], points, targets)
