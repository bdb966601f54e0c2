"""The servo law against (17) and damped least squares in float64, and the bounds it keeps."""

from typing import Any

import numpy as np
import pytest
from reference_control import damped_servo_step, servo_step

from dense_vs import DenseVSError, VisualServo

# Both sides are float64.
TOLERANCE = 1e-9

RNG = np.random.default_rng(0)
FREE: dict[str, Any] = {"max_step": 1e3, "dither": 0.0}


@pytest.mark.parametrize("joints", [2, 3, 7])
def test_law_as_printed(joints):
    J, point, target = RNG.normal(0, 100, (2, joints)), RNG.normal(0, 50, 2), RNG.normal(0, 50, 2)
    step = VisualServo(joints, gain=0.7, damping=0, **FREE)(J, point, target)
    np.testing.assert_allclose(step, servo_step(J, target - point, 0.7), rtol=TOLERANCE)
    np.testing.assert_allclose(J @ step, 0.7 * (target - point), rtol=TOLERANCE)


@pytest.mark.parametrize("joints", [1, 2, 4])
@pytest.mark.parametrize("damping", [1e-3, 15.0, 500.0])
def test_damped_law(joints, damping):
    J, error = RNG.normal(0, 100, (2, joints)), RNG.normal(0, 50, 2)
    step = VisualServo(joints, gain=0.3, damping=damping, **FREE)(J, np.zeros(2), error)
    np.testing.assert_allclose(step, damped_servo_step(J, error, 0.3, damping), rtol=1e-6)


def test_unlearned_jacobian_commands_nothing():
    servo = VisualServo(4)
    np.testing.assert_array_equal(servo(np.zeros((2, 4)), [10.0, 10.0], [90.0, 50.0]), 0)


def test_singular_jacobian_stays_finite():
    J = np.outer([1.0, 2.0], [30.0, -10.0, 5.0])
    for damping in (0.0, 15.0):
        step = VisualServo(3, damping=damping, **FREE)(J, np.zeros(2), np.array([2.0, -1.0]))
        np.testing.assert_allclose(step, 0, atol=1e-9)  # the error is across what the joints can do


def test_long_steps_are_shortened_as_a_whole():
    J, error = RNG.normal(0, 100, (2, 4)), np.array([300.0, -200.0])
    whole = damped_servo_step(J, error, 0.2, 15.0)
    step = VisualServo(4, max_step=0.03, dither=0)(J, np.zeros(2), error)
    assert np.abs(step).max() == pytest.approx(0.03)
    np.testing.assert_allclose(step / np.linalg.norm(step), whole / np.linalg.norm(whole), atol=1e-9)


def test_iterating_reaches_the_target_without_passing_a_limit():
    limits = np.array([[-0.5, 0.5], [-0.1, 0.1], [-1.0, 0.2], [-0.3, 0.3]])
    J = np.array([[80.0, 120, 20, -40], [-60, 40, 90, 30]])
    servo = VisualServo(4, joint_limits=limits, seed=1)
    q, target = np.zeros(4), J @ np.array([0.3, 0.1, -0.5, 0.1])
    for _ in range(150):
        q = q + servo(J, J @ q, target, q)
        assert (q >= limits[:, 0] - 1e-12).all()
        assert (q <= limits[:, 1] + 1e-12).all()
    assert np.linalg.norm(J @ q - target) < 2.0


def test_remaining_joints_take_over():
    J = np.array([[100.0, 50, 0], [0, 20, 80]])
    limits = np.array([[-1.0, 0.0], [-1.0, 1.0], [-1.0, 1.0]])
    error = np.array([5.0, 3.0])
    free = VisualServo(3, damping=0, gain=1.0, **FREE)(J, np.zeros(2), error)
    assert free[0] > 0
    step = VisualServo(3, joint_limits=limits, damping=0, gain=1.0, **FREE)(J, np.zeros(2), error, np.zeros(3))
    assert step[0] == 0
    np.testing.assert_allclose(J @ step, error, rtol=TOLERANCE)
    np.testing.assert_allclose(step[1:], servo_step(J[:, 1:], error, 1.0), rtol=TOLERANCE)


def test_joint_outside_its_limits_may_only_come_back():
    J = np.eye(2) * 100
    servo = VisualServo(2, joint_limits=[[-1, 1], [-1, 1]], **FREE)
    q = np.array([1.2, 0.0])
    assert servo(J, [0.0, 0.0], [50.0, 10.0], q)[0] == 0
    assert servo(J, [0.0, 0.0], [-50.0, 10.0], q)[0] < 0
    assert servo(J, [0.0, 0.0], [50.0, 10.0], q)[1] > 0


@pytest.mark.parametrize("seed", range(20))
def test_limits_and_longest_step_hold_together(seed):
    rng = np.random.default_rng(seed)
    limits = np.sort(rng.normal(0, 0.02, (5, 2)), axis=1)
    q = rng.uniform(limits[:, 0], limits[:, 1])
    servo = VisualServo(5, joint_limits=limits, max_step=0.01, gain=1.0, dither=0.0)
    step = servo(rng.normal(0, 100, (2, 5)), np.zeros(2), rng.normal(0, 20, 2), q)
    assert np.abs(step).max() <= 0.01 * (1 + 1e-9)
    assert (q + step >= limits[:, 0] - 1e-12).all()
    assert (q + step <= limits[:, 1] + 1e-12).all()


def test_dither_stays_within_the_limits():
    servo = VisualServo(2, joint_limits=[[-1.0, 1.0], [-1.0, 1.0]], dither=0.5, seed=3)
    q = np.array([1.0, -1.0])
    steps = np.array([servo(np.eye(2) * 100, np.zeros(2), [-1.0, 1.0], q) for _ in range(50)])
    assert (q + steps >= -1).all()
    assert (q + steps <= 1).all()
    assert (steps == 0).any()  # dither met a limit


def test_dither():
    J, error = RNG.normal(0, 100, (2, 3)), np.array([10.0, 20.0])

    def steps(seed, dither, count=400, share=1.0):
        servo = VisualServo(3, dither=dither, seed=seed)
        return np.array([servo(J, np.zeros(2), share * error) for _ in range(count)])

    silent = steps(0, 0.0, count=3)
    np.testing.assert_array_equal(silent, np.broadcast_to(silent[0], silent.shape))
    dithered = steps(1, 0.002)
    np.testing.assert_array_equal(dithered, steps(1, 0.002))
    assert (dithered != steps(2, 0.002)).any()
    np.testing.assert_allclose(dithered.mean(axis=0), silent[0], atol=5 * 0.002 / 20)
    np.testing.assert_allclose(dithered.std(axis=0), 0.002, rtol=0.2)
    near, still = steps(1, 0.002, share=0.01), steps(1, 0.0, count=1, share=0.01)
    assert 0 < np.abs(still).max() < 0.001
    np.testing.assert_allclose(near.std(axis=0), np.abs(still).max(), rtol=0.2)  # it fades at the target


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"joints": 0}, "joints is 0; expected a whole number of at least 1"),
        ({"joints": 2.0}, "joints is 2.0; expected"),
        ({"joints": "two"}, "joints is 'two'; expected"),
        ({"gain": 0}, "gain is 0; expected a finite number above 0"),
        ({"gain": "high"}, "gain is 'high'; expected"),
        ({"damping": -1}, "damping is -1; expected a finite number of at least 0"),
        ({"max_step": float("inf")}, "max_step is inf; expected"),
        ({"dither": float("nan")}, "dither is nan; expected"),
        ({"joint_limits": [[0, 1]]}, "expected 3 pairs"),
        ({"joint_limits": [[0, 1], [0, 1], [1, 0]]}, "expected 3 pairs"),
        ({"joint_limits": [[0, 1], [0, 1], [0, np.nan]]}, "expected 3 pairs"),
        ({"joint_limits": [[0, 1], [0, 1], [0]]}, "expected 3 pairs"),
        ({"joint_limits": "none"}, "expected 3 pairs"),
    ],
    ids=str,
)
def test_refuses_options(arguments, message):
    with pytest.raises(DenseVSError, match=message):
        VisualServo(**{"joints": 3, **arguments})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((2, 4)), [0.0, 0.0], [1.0, 1.0], np.zeros(3)), r"jacobian has shape \(2, 4\)"),
        ((np.zeros((1, 2, 3)), [0.0, 0.0], [1.0, 1.0], np.zeros(3)), r"jacobian has shape \(1, 2, 3\)"),
        ((np.full((2, 3), np.nan), [0.0, 0.0], [1.0, 1.0], np.zeros(3)), "jacobian is .*expected finite"),
        ((np.ones((2, 3)), [0.0, np.nan], [1.0, 1.0], np.zeros(3)), "point"),
        ((np.ones((2, 3)), [0.0, 0.0], [1.0, np.inf], np.zeros(3)), "target"),
        ((np.ones((2, 3)), [0.0, 0.0], [1.0, 1.0, 1.0], np.zeros(3)), "target"),
        ((np.ones((2, 3)), [[0.0, 0.0], [1.0, 1.0]], [1.0, 1.0], np.zeros(3)), "point"),
        ((np.ones((2, 3)), [0.0, 0.0], "there", np.zeros(3)), "target"),
        ((np.ones((2, 3)), [0.0, 0.0], 3.0, np.zeros(3)), "target"),
        ((np.ones((2, 3)), [0.0, 0.0], [1.0, 1.0], None), "positions are missing; expected the joint positions"),
        ((np.ones((2, 3)), [0.0, 0.0], [1.0, 1.0], np.zeros(2)), r"positions has shape \(2,\)"),
        ((np.ones((2, 3)), [0.0, 0.0], [1.0, 1.0], np.full(3, np.nan)), "positions is .*expected finite"),
    ],
)
def test_refuses_a_call(arguments, message):
    with pytest.raises(DenseVSError, match=message):
        VisualServo(3, joint_limits=[[-1, 1]] * 3)(*arguments)


def test_whole_numbers_are_welcome_as_points():
    J = np.eye(2) * 100
    np.testing.assert_array_equal(
        VisualServo(2, dither=0)(J, [1, 2], (3, 4)), VisualServo(2, dither=0)(J, np.array([1.0, 2]), np.array([3.0, 4]))
    )


@pytest.mark.parametrize("options", [{}, {"gain": 1e300}, {"damping": 0.0}, {"damping": 1e300}, {"gain": 1e308}])
@pytest.mark.parametrize("size", [1.0, 1e9, 1e160, 1e308, 1e-300])
@pytest.mark.parametrize("rank", [1, 2])
def test_no_number_is_too_large_for_a_step(options, size, rank):
    J = size * np.array([[1.0, -0.5, 0.25], [0.5, 1.0, 0.1]])
    if rank == 1:
        J[1] = 2 * J[0] if size < 1e300 else J[0]
    servo = VisualServo(3, joint_limits=[[-0.5, 0.001]] * 3, dither=0.0, **options)
    for target in ([90.0, 50.0], [1e300, -1e300]):
        step = servo(J, [10.0, 10.0], target, np.zeros(3))
        assert np.isfinite(step).all()
        assert np.abs(step).max() <= servo.options.max_step * (1 + 1e-12)
        assert (step <= 0.001).all()


def test_joints_that_are_held_stay_and_the_others_do_without():
    J = np.array([[100.0, 0.0, 50.0], [0.0, 100.0, 30.0]])
    servo = VisualServo(3, gain=0.1, damping=0, **FREE)
    step = servo(J, [0.0, 0.0], [10.0, 4.0], held=[True, False, False])
    assert step[0] == 0
    np.testing.assert_allclose(J @ step, [1.0, 0.4])
