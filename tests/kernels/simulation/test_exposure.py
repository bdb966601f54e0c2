"""Poses within an exposure, light gathered over it, and the sensor, against float64."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from dense_vs.kernels.launch import launch_pixels
from dense_vs.kernels.simulation.exposure import carried_poses_kernel, develop_kernel, gather_light_kernel

POSE_TOLERANCE = 2e-6  # float32 rotations and positions of about 1
SHAPE = (2, 11, 17)


@pytest.mark.parametrize("frames", [-0.4, 0.0, 0.3, 1.0])
def test_poses_carry_on_the_last_motion(frames):
    rng = np.random.default_rng(0)
    count = 6
    now, turn = Rotation.random(count, rng), Rotation.from_rotvec(rng.uniform(-0.1, 0.1, (count, 3)))
    turn = Rotation.concatenate([turn[:-1], Rotation.identity()])  # one stands still
    position, step = rng.uniform(-1, 1, (count, 3)), rng.uniform(-0.1, 0.1, (count, 3))
    given = [position, now.as_matrix(), position - step, (turn.inv() * now).as_matrix()]
    arrays = [
        wp.array(value[None].astype(np.float32), dtype=kind, device="cpu")
        for value, kind in zip(given, (wp.vec3, wp.mat33) * 2, strict=True)
    ]
    out = [wp.full((1, count), np.nan, dtype=kind, device="cpu") for kind in (wp.vec3, wp.mat33)]
    wp.launch(carried_poses_kernel, dim=(1, count), inputs=[frames, *arrays], outputs=out, device="cpu")
    expected = (Rotation.from_rotvec(frames * turn.as_rotvec()) * now).as_matrix()
    np.testing.assert_allclose(out[0].numpy()[0], position + frames * step, atol=POSE_TOLERANCE)
    np.testing.assert_allclose(out[1].numpy()[0], expected, atol=POSE_TOLERANCE)


@pytest.mark.parametrize("threads", [1, 3])
def test_light_is_the_weighted_sum_of_a_rows_instants(threads):
    rng = np.random.default_rng(1)
    colors = rng.integers(0, 256, (3, *SHAPE, 3)).astype(np.uint32)
    weights = rng.uniform(0, 1, (3, SHAPE[1])) * (rng.uniform(0, 1, (3, SHAPE[1])) < 0.7)
    light = wp.zeros(SHAPE, dtype=wp.vec3, device="cpu")
    for color, weight in zip(colors, weights, strict=True):
        packed = (color[..., 0] << 16 | color[..., 1] << 8 | color[..., 2]) | np.uint32(0xFF000000)
        packed = wp.array(packed.reshape(SHAPE[0], -1), dtype=wp.uint32, device="cpu")
        share = wp.array(weight.astype(np.float32), dtype=float, device="cpu")
        launch_pixels(gather_light_kernel, SHAPE, [packed, share, light], "cpu", threads)
    expected = np.einsum("kwyxc,ky->wyxc", colors.astype(float), weights)
    np.testing.assert_allclose(light.numpy(), expected, atol=1e-3)


def developed(light, times=(0.0, 0.0), seeds=(5, 6), flicker=0.0, vignette=0.0, noise=0.0):
    rgb = wp.full(light.shape[:3], wp.vec3ub(7, 7, 7), dtype=wp.vec3ub, device="cpu")
    arguments = [
        wp.array(light.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(np.array(times, dtype=np.float32), dtype=float, device="cpu"),
        wp.array(np.array(seeds, dtype=np.int32), dtype=int, device="cpu"),
        *(1 / 30, flicker, vignette, noise),
        rgb,
    ]
    launch_pixels(develop_kernel, light.shape[:3], arguments, "cpu", 2)
    return rgb.numpy()


def test_corners_lose_their_share_of_light():
    light = np.random.default_rng(2).uniform(-10, 300, (*SHAPE, 3))
    y, x = (np.linspace(-1, 1, side) for side in SHAPE[1:])
    expected = light * (1 - 0.3 * (y[:, None] ** 2 + x**2) / 2)[..., None]
    assert np.abs(developed(light, vignette=0.3) - np.clip(expected, 0, 255)).max() <= 0.5 + 1e-3


def test_noise_is_normal_gray_and_new_in_every_world_and_frame():
    flat = np.full((2, 120, 160, 3), 128.0)
    first = developed(flat, noise=6.0).astype(float) - 128
    np.testing.assert_array_equal(first, developed(flat, noise=6.0).astype(float) - 128)
    np.testing.assert_array_equal(first[..., 0], first[..., 2])
    later = developed(flat, times=(1 / 30, 2 / 30), noise=6.0).astype(float) - 128
    fields = [field[..., 0].ravel() for field in (*first, *later)]
    for field in fields:
        assert field.mean() == pytest.approx(0.0, abs=0.2)
        assert field.std() == pytest.approx(6.0, rel=0.02)
        assert np.mean(np.abs(field) > 12.5) == pytest.approx(0.037, abs=0.006)  # of a normal distribution
    assert np.abs(np.corrcoef(fields) - np.eye(4)).max() < 0.03
    assert abs(np.corrcoef(fields[0][1:], fields[0][:-1])[0, 1]) < 0.03  # of neighbors


def test_flicker_is_one_gain_a_frame():
    flat = np.full((2, 8, 8, 3), 100.0)
    frames = [developed(flat, times=(k / 30, k / 30), flicker=0.1) for k in range(200)]
    gains = np.array(frames)[..., 0].reshape(200, 2, -1) / 100.0
    assert np.ptp(gains, axis=2).max() == 0.0
    np.testing.assert_allclose(gains[..., 0].std(axis=0), 0.1, rtol=0.2)
    assert abs(np.corrcoef(gains[:, 0, 0], gains[:, 1, 0])[0, 1]) < 0.25
