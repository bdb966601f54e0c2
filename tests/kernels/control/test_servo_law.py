"""The servo law of many worlds against VisualServo, one world at a time in float64."""

import numpy as np
import pytest
import warp as wp
from reference_control import damped_servo_step, servo_step

from dense_vs import VisualServo
from dense_vs.kernels.control.servo_law import limits_array, servo_steps

# float32 J, positions and steps.
RELATIVE, ABSOLUTE = 1e-5, 1e-7

WORLDS = 200


def random_worlds(joints, seed=0):
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(0, 100, (WORLDS, 2, joints)).astype(np.float32)
    points, targets = rng.uniform(0, 200, (2, WORLDS, 2))
    limits = np.sort(rng.normal(0, 0.02, (joints, 2)), axis=1).astype(np.float32)
    positions = rng.uniform(limits[:, 0] - 0.004, limits[:, 1] + 0.004, (WORLDS, joints)).astype(np.float32)
    return jacobian, points, targets, positions, limits


class Batch:
    """Arrays on a device and the launch; steps begin as NaN."""

    def __init__(self, jacobian, points, targets, positions=None, limits=None, where=None, device="cpu"):
        worlds, _, joints = jacobian.shape
        positions = np.zeros((worlds, joints)) if positions is None else positions
        where = np.ones(worlds) if where is None else where
        self.inputs = [
            wp.array(np.asarray(jacobian, dtype=np.float32), device=device),
            *(wp.array(a, dtype=wp.vec2d, device=device) for a in (points, targets)),
            wp.array(positions.astype(np.float32), device=device),
            limits_array(limits, joints, device),
            wp.array(where, dtype=int, device=device),
            wp.array(np.arange(worlds) + 5, dtype=wp.uint32, device=device),
        ]
        self.draws = wp.zeros(worlds, dtype=wp.uint32, device=device)
        self.steps = wp.full((worlds, joints), float("nan"), dtype=float, device=device)

    def __call__(self, *, gain=0.2, damping=15.0, max_step=0.03, dither=0.0):
        options = {"gain": gain, "damping": damping, "max_step": max_step, "dither": dither}
        servo_steps(*self.inputs, self.draws, self.steps, **options)
        return self.steps.numpy().copy()


@pytest.mark.parametrize("joints", [1, 2, 3, 7, 32])
@pytest.mark.parametrize("damping", [0.0, 1.0, 15.0, 500.0])
def test_each_world_as_visual_servo(joints, damping):
    jacobian, points, targets, positions, limits = random_worlds(joints)
    for bound in (limits, None):
        for max_step in (0.01, 1e3):
            servo = VisualServo(joints, joint_limits=bound, damping=damping, max_step=max_step, dither=0.0)
            steps = Batch(jacobian, points, targets, positions, bound)(damping=damping, max_step=max_step)
            expected = [
                servo(J.astype(float), p, t, q.astype(float))
                for J, p, t, q in zip(jacobian, points, targets, positions, strict=True)
            ]
            np.testing.assert_allclose(steps, expected, rtol=RELATIVE, atol=ABSOLUTE)


@pytest.mark.parametrize("joints", [2, 4])
def test_each_world_as_the_equation(joints):
    jacobian, points, targets, _, _ = random_worlds(joints, seed=1)
    printed = Batch(jacobian, points, targets)(damping=0.0, max_step=1e3, gain=0.7)
    damped = Batch(jacobian, points, targets)(damping=20.0, max_step=1e3, gain=0.7)
    for k in range(WORLDS):
        J, error = jacobian[k].astype(float), targets[k] - points[k]
        np.testing.assert_allclose(printed[k], servo_step(J, error, 0.7), rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(damped[k], damped_servo_step(J, error, 0.7, 20.0), rtol=1e-4, atol=1e-6)


def test_singular_and_unlearned_jacobians():
    J = np.stack([np.outer([1.0, 2.0], [30.0, -10.0, 5.0]), np.zeros((2, 3))])
    batch = Batch(J, np.zeros((2, 2)), np.array([[2.0, -1.0], [50.0, 50.0]]))
    for damping in (0.0, 15.0):
        np.testing.assert_allclose(batch(damping=damping, dither=0.01)[1], 0)
        np.testing.assert_allclose(batch(damping=damping)[0], 0, atol=1e-8)  # across what the joints can do
    along = Batch(J[:1], np.zeros((1, 2)), np.array([[1.0, 2.0]]))(damping=0.0, gain=1.0, max_step=1e3)
    np.testing.assert_allclose(along[0], np.linalg.pinv(J[0]) @ [1.0, 2.0], rtol=RELATIVE)


@pytest.mark.parametrize("what", ["jacobian", "point", "target", "positions"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_world_without_numbers_rests_alone(what, value):
    jacobian, points, targets, positions, limits = random_worlds(3)
    sound = Batch(jacobian, points, targets, positions, limits)(dither=0.002)
    {"jacobian": jacobian, "point": points, "target": targets, "positions": positions}[what][7, ..., 1] = value
    steps = Batch(jacobian, points, targets, positions, limits)(dither=0.002)
    np.testing.assert_array_equal(steps[7], 0)
    np.testing.assert_array_equal(np.delete(steps, 7, axis=0), np.delete(sound, 7, axis=0))


def test_only_the_chosen_worlds_step():
    jacobian, points, targets, positions, limits = random_worlds(3)
    where = np.arange(WORLDS) % 3
    batch = Batch(jacobian, points, targets, positions, limits, where)
    steps = batch(dither=0.01)
    np.testing.assert_array_equal(np.isnan(steps).all(axis=1), where == 0)
    np.testing.assert_array_equal(batch.draws.numpy(), where != 0)


def test_dither():
    jacobian = np.repeat(np.random.default_rng(0).normal(0, 100, (1, 2, 3)), 300, axis=0)
    batch = Batch(jacobian, np.zeros((300, 2)), np.tile([10.0, 20.0], (300, 1)))
    silent = batch()
    assert np.abs(silent).max() > 0.002
    np.testing.assert_array_equal(silent, silent[:1].repeat(300, axis=0))
    many = np.array([batch(dither=0.002) for _ in range(20)]) - silent
    np.testing.assert_allclose(many.mean(axis=(0, 1)), 0, atol=5 * 0.002 / np.sqrt(6000))
    np.testing.assert_allclose(many.std(axis=(0, 1)), 0.002, rtol=0.05)
    flat = many.reshape(-1, 3)
    assert len(np.unique(flat, axis=0)) == len(flat)  # no world or time repeats another one's
    assert np.abs(np.corrcoef(flat.T) - np.eye(3)).max() < 0.06
    assert abs(np.corrcoef(many[:-1].ravel(), many[1:].ravel())[0, 1]) < 0.06
    assert abs(np.corrcoef(many[:, :-1].ravel(), many[:, 1:].ravel())[0, 1]) < 0.06
    again = Batch(jacobian, np.zeros((300, 2)), np.tile([10.0, 20.0], (300, 1)))
    again()
    np.testing.assert_array_equal(again(dither=0.002) - silent, many[0])


def test_dither_fades_at_the_target():
    jacobian = np.repeat(np.random.default_rng(0).normal(0, 100, (1, 2, 3)), 300, axis=0)
    batch = Batch(jacobian, np.zeros((300, 2)), np.tile([0.1, 0.2], (300, 1)))
    silent = batch()
    many = np.array([batch(dither=0.002) for _ in range(20)]) - silent
    np.testing.assert_allclose(many.std(axis=(0, 1)), np.abs(silent).max(), rtol=0.05)


def test_dither_stays_within_the_limits():
    jacobian, points, targets, positions, limits = random_worlds(4)
    positions = np.clip(positions, limits[:, 0], limits[:, 1])
    steps = Batch(jacobian, points, targets, positions, limits)(dither=0.5)
    assert (positions + steps >= limits[:, 0] - 1e-6).all()
    assert (positions + steps <= limits[:, 1] + 1e-6).all()
    assert (steps == 0).any()


@pytest.mark.parametrize("shape", [(4, 3, 2), (4, 2, 33), (4, 2, 0)])
def test_refuses_a_shape(shape):
    arrays = [wp.zeros(shape, dtype=float, device="cpu"), *[None] * 8]
    with pytest.raises(ValueError, match=r"jacobian has shape .*expected \(worlds, 2, N\)"):
        servo_steps(*arrays, gain=0.2, damping=15.0, max_step=0.03, dither=0.0)


@pytest.mark.gpu
def test_the_same_on_a_gpu_in_a_graph():
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    inputs = random_worlds(4)
    on_cpu, on_gpu = Batch(*inputs), Batch(*inputs, device="cuda:0")
    np.testing.assert_allclose(on_gpu(dither=0.002), on_cpu(dither=0.002), rtol=1e-4, atol=1e-6)
    with wp.ScopedCapture("cuda:0") as capture:
        servo_steps(*on_gpu.inputs, on_gpu.draws, on_gpu.steps, gain=0.2, damping=15.0, max_step=0.03, dither=0.002)
    for _ in range(3):
        wp.capture_launch(capture.graph)
        np.testing.assert_allclose(on_gpu.steps.numpy(), on_cpu(dither=0.002), rtol=1e-4, atol=1e-6)
