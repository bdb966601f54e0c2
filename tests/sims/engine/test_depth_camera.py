"""The simulated depth camera: noise and steps of inverse depth as asked, holes where they belong."""

import numpy as np
import pytest
import warp as wp

from dense_vs import Camera, DenseVSError
from dense_vs.kernels.launch import launch_pixels
from dense_vs.kernels.simulation.depth_sensor import measured_depth_kernel
from dense_vs.robot import DepthCamera
from dense_vs.sims import DepthSensor, SimCamera, SimDepthCamera, SimWorld

FOCAL = 60.0
EXACT = {"noise": 0.0, "resolution": 0.0, "baseline": 0.0, "grain": 1, "steepest": 80.0, "dropout": 0.0}


def measured(depth, *, time=0.5, seed=3, threads=1, **options):
    """A depth image (H, W), or several worlds', as the kernel measures it."""
    exact = np.atleast_3d(depth.T).T.astype(np.float32)
    out = wp.full(exact.shape, np.nan, dtype=float, device="cpu")
    o = EXACT | options
    steepest = float(np.tan(np.deg2rad(o["steepest"])))
    arguments = [
        wp.array(exact, device="cpu"), wp.full(len(exact), time, dtype=float, device="cpu"), seed, 1 / 30, FOCAL,
        o["baseline"], o["noise"], o["grain"], o["resolution"], steepest, o["dropout"], out,
    ]  # fmt: skip
    launch_pixels(measured_depth_kernel, exact.shape, arguments, "cpu", threads)
    return out.numpy()[0] if depth.ndim == 2 else out.numpy()


@pytest.mark.parametrize("grain", [1, 4])
@pytest.mark.parametrize("z", [0.5, 2.0])
def test_noise_grows_with_the_square_of_depth(z, grain):
    off = measured(np.full((90, 120), z), noise=0.004, grain=grain) - z
    assert off.std() == pytest.approx(0.004 * z**2, rel=0.1)
    assert abs(off.mean()) < 0.2 * off.std()
    neighbors = np.corrcoef(off[:, :-1].ravel(), off[:, 1:].ravel())[0, 1]
    assert neighbors < 0.05 if grain == 1 else neighbors > 0.7


def test_noise_is_new_in_every_frame_and_world_and_the_same_when_asked_again():
    flat = np.ones((2, 20, 30))
    one, other = measured(flat, noise=0.01)
    assert (one != other).mean() > 0.99
    assert (one != measured(flat, noise=0.01, time=0.5 + 1 / 30)[0]).mean() > 0.99
    assert (one != measured(flat, noise=0.01, seed=4)[0]).mean() > 0.99
    np.testing.assert_array_equal(measured(flat, noise=0.01, threads=3), [one, other])


def test_inverse_depth_comes_in_steps():
    exact = np.linspace(0.8, 1.3, 600).reshape(20, 30)
    found = 1 / measured(exact, resolution=0.02)
    np.testing.assert_allclose(found / 0.02, np.rint(found / 0.02), atol=1e-3)
    assert np.abs(found - 1 / exact).max() < 0.0101


def test_exact_depth_is_exact():
    exact = np.linspace(0.5, 1.0, 600).reshape(20, 30)
    np.testing.assert_allclose(measured(exact), exact, rtol=1e-6)


def test_no_depth_beside_what_stands_in_front():
    """By rays of a second eye, b to the side: it sees a point of the wall unless the front's edge is before it."""
    wall, front, edge, baseline = 2.0, 0.8, 40, 0.3
    exact = np.where(np.arange(80) >= edge, front, wall) * np.ones((12, 1))
    hidden = measured(exact, baseline=baseline)[6] == 0
    x = np.arange(80)
    shift = FOCAL * baseline
    in_other_eye = x - shift / wall
    expected = (x < edge) & (in_other_eye >= edge - shift / front)
    outline = (x == edge) | (x == edge - 1)
    np.testing.assert_array_equal(hidden[~outline], expected[~outline])
    assert hidden[outline].all()
    assert 8 <= expected.sum() <= 20


def test_no_depth_where_a_surface_is_seen_at_a_grazing_angle():
    for degrees, seen in ((60.0, True), (85.0, False)):
        slope = np.tan(np.deg2rad(degrees)) / FOCAL  # of log Z a pixel, along the middle row
        exact = np.exp(slope * np.arange(-15, 15)) * np.ones((9, 1))
        assert ((measured(exact, steepest=75.0) > 0) == seen).all()


def test_nothing_where_there_is_no_surface_and_a_share_that_drops_out():
    exact = np.ones((60, 80))
    exact[:, :3] = 0.0
    found = measured(exact, dropout=0.2, grain=2)
    assert not found[:, :4].any()
    assert (found[:, 4:] == 0).mean() == pytest.approx(0.2, abs=0.03)


@pytest.fixture(scope="module")
def world():
    return SimWorld("arm", seed=1, device="cpu", height=60, width=80)


def test_the_camera_gives_depth_of_its_image(world):
    camera = SimDepthCamera(world)
    assert isinstance(camera, DepthCamera)
    assert isinstance(camera, Camera)
    assert not isinstance(SimCamera(world), DepthCamera)
    with pytest.raises(DenseVSError, match=r"expected read\(\) before depth\(\)"):
        camera.depth()
    image, time = camera.read()
    np.testing.assert_array_equal(image, world.frame().rgb)
    assert time == world.time
    np.testing.assert_array_equal(camera.depth(), world.frame().depth)
    noisy = SimDepthCamera(world, DepthSensor(), seed=5)
    noisy.read()
    found, exact = noisy.depth(), world.frame().depth
    known = found > 0
    assert found.shape == exact.shape
    assert 0.6 < known.mean() < 0.99
    off = 1 / found[known] - 1 / exact[known]
    assert off.std() == pytest.approx(np.hypot(0.003, 0.002 / np.sqrt(12)), rel=0.15)
    outline = world.robot_mask()[:, 1:] != world.robot_mask()[:, :-1]
    assert known[:, 1:][outline].mean() < 0.5 * known.mean()


def test_the_seed_decides_a_camera_s_noise(world):
    seen = []
    for seed in (0, 1, 0):
        camera = SimDepthCamera(world, DepthSensor(), seed=seed)
        camera.read()
        seen.append(camera.depth())
    known = (seen[0] > 0) & (seen[1] > 0)
    assert (seen[0] != seen[1])[known].mean() > 0.5  # others fall on the same step
    np.testing.assert_array_equal(seen[0], seen[2])


def test_refuses(world):
    for options in ({"noise": -1}, {"grain": 0}, {"steepest": 90}, {"dropout": 2}, {"baseline": "wide"}):
        with pytest.raises(DenseVSError, match=next(iter(options))):
            DepthSensor(**options)
    with pytest.raises(DenseVSError, match="sensor is a float; expected a DepthSensor"):
        SimDepthCamera(world, 0.01)
    with pytest.raises(DenseVSError, match="has 2 worlds; expected 1"):
        SimDepthCamera(SimWorld("planar", worlds=2, device="cpu", height=16, width=16))
