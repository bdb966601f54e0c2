"""Realism changes what is seen and read, as much as it says, and nothing of the truth."""

from dataclasses import asdict

import numpy as np
import pytest
import warp as wp

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.exposure import shots_of
from dense_vs.sims.engine.realism import PRESETS, Realism
from dense_vs.sims.papers.dije.reaching import ReachingExperiment

SIZE = {"device": "cpu", "height": 48, "width": 64}
STEPS = 0.02 * np.random.default_rng(0).normal(size=(6, 3))


def make(**options):
    return SimWorld("planar", seed=2, realism=Realism(**options), **SIZE)


@pytest.fixture(scope="module")
def clean():
    return SimWorld("planar", seed=2, **SIZE)


def test_noise_is_as_strong_as_asked_and_new_in_every_frame(clean):
    clean.reset()
    world = make(noise=4.0)
    off = world.frame().rgb.astype(float) - clean.frame().rgb
    inside = (clean.frame().rgb > 20) & (clean.frame().rgb < 235)
    assert off[inside].std() == pytest.approx(4.0, rel=0.05)
    np.testing.assert_array_equal(world.frame().rgb, world.frame().rgb)
    before = world.frame().rgb
    world.step()
    assert np.any(world.frame().rgb != before)


def test_flicker_scales_the_image(clean):
    clean.reset()
    world = make(flicker=0.1)
    brightness = []
    for _ in range(30):
        world.step()
        brightness.append(world.frame().rgb.mean() / clean.frame().rgb.mean())
    assert 0.05 < np.std(brightness) < 0.15


def test_vignette_darkens_the_corners_alone(clean):
    clean.reset()
    image, flat = make(vignette=0.4).frame().rgb.astype(float), clean.frame().rgb.astype(float)
    np.testing.assert_allclose(image[0, 0], 0.6 * flat[0, 0], atol=0.5)
    np.testing.assert_allclose(image[24, 32], flat[24, 32], atol=0.6)


def test_compression_is_that_of_its_quality(clean):
    clean.reset()
    off = [np.abs(make(jpeg_quality=q).frame().rgb.astype(float) - clean.frame().rgb).mean() for q in (30, 70, 95)]
    assert off[0] > off[1] > off[2] > 0


def test_readings_are_late_and_the_truth_is_not(clean):
    clean.reset()
    world = make(late_frames=2)
    true = [clean.joints()[0]]
    for step in STEPS:
        for each in (clean, world):
            each.step(step)
        true.append(clean.joints()[0])
        expected = true[max(0, len(true) - 3)]
        np.testing.assert_allclose(world.joints()[0], expected, atol=1e-6)
        times, history = world.joint_history()
        assert len(times) == len(history)
        np.testing.assert_allclose(history[-1], expected, atol=1e-6)
        np.testing.assert_array_equal(world.true_flow(), clean.true_flow())
        np.testing.assert_array_equal(world.frame().rgb, clean.frame().rgb)
    world.reset()
    np.testing.assert_allclose(world.joints()[0], true[0], atol=1e-6)


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize(("blur", "readout"), [(0.0, 0.0), (0.4, 0.0), (0.0, 0.6), (0.3, 0.5), (1.0, 1.0)])
def test_shots_share_out_every_rows_exposure(blur, readout, samples):
    height = 50
    shots = shots_of(Realism(blur=blur, readout=readout), height, samples)
    weights, times = np.array([shot.weights for shot in shots]), np.array([shot.frames for shot in shots])
    squares = np.array([shot.square for shot in shots])
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    middle = readout * ((np.arange(height) + 0.5) / height - 0.5)
    part = np.diff(np.unique(times)).max() if len(np.unique(times)) > 1 else 0.0
    np.testing.assert_allclose(weights.T @ times, middle, atol=0.51 * part + 1e-9)
    assert np.average(middle) == pytest.approx(0.0)
    exposed = [np.ptp(times[row > 0]) for row in weights.T]
    assert np.max(exposed) <= blur + part + 1e-9
    for k in range(samples**2):
        assert np.all(weights[squares == k].sum(axis=0) > 0.4 / samples**2)


def posed(world, posture):
    """Image of a world at rest in a posture."""
    world.reset()
    world.physics.reset(posture[None])
    world.physics.update_poses()
    world._rendered = False
    return world.frame().rgb.astype(float)


@pytest.mark.parametrize(("blur", "readout"), [(0.6, 0.0), (0.0, 0.5), (0.3, 0.4)])
def test_exposure_is_the_mean_of_images_within_it(clean, blur, readout):
    clean.reset()
    world = make(blur=blur, readout=readout)
    postures = []
    for _ in range(3):
        for each in (clean, world):
            each.step([0.12, -0.1, 0.15])
        postures.append(clean.physics.host_state(0).qpos.copy())
    truth = clean.true_flow(), clean.true_jacobian(), clean.robot_mask(), clean.frame().depth, clean.frame().ids
    seen = world.frame()
    for found, exact in zip(
        (world.true_flow(), world.true_jacobian(), world.robot_mask(), seen.depth, seen.ids), truth, strict=True
    ):
        np.testing.assert_array_equal(found, exact)
    now, velocity = postures[-1], postures[-1] - postures[-2]
    expected = np.zeros(seen.rgb.shape)
    for shot in shots_of(world.realism, 48, 1):
        expected += shot.weights[:, None, None] * posed(clean, now + shot.frames * velocity)
    off = np.abs(seen.rgb - expected)
    assert off.mean() < 0.5  # of rounding and of what lies on an outline
    assert np.percentile(off, 98) < 3
    assert np.abs(seen.rgb - posed(clean, now)).mean() > 3 * off.mean()


def test_what_stands_still_is_neither_blurred_nor_bent(clean):
    clean.reset()
    for world in (clean, make(blur=0.5, readout=0.5)):
        for _ in range(60):
            world.step()
    np.testing.assert_allclose(world.frame().rgb.astype(float), clean.frame().rgb, atol=1)


def test_shadows_darken(clean):
    path = "arm"
    lit, shaded = (
        SimWorld(path, seed=1, realism=Realism(shadows=shadows), **SIZE).frame().rgb.astype(int)
        for shadows in (False, True)
    )
    darker = (lit - shaded).max(axis=-1)
    assert 0.01 < np.mean(darker > 8) < 0.8
    assert np.all(shaded <= lit)


def test_presets_are_named():
    clean = SimWorld("planar", seed=2, **SIZE)
    assert clean.realism is None
    for name in PRESETS:
        assert SimWorld("planar", seed=2, realism=name, **SIZE).realism is PRESETS[name]
    assert SimWorld("planar", seed=2, realism=True, **SIZE).realism is PRESETS["realistic"]


def test_presets_are_what_they_are():
    """Every figure of a simulated robot that names one depends on these numbers."""
    assert {name: asdict(preset) for name, preset in PRESETS.items()} == {
        "realistic": {
            "noise": 4.0,
            "flicker": 0.03,
            "vignette": 0.25,
            "jpeg_quality": 70,
            "blur": 0.3,
            "readout": 0.5,
            "distortion": (-0.08, 0.02),
            "shadows": True,
            "sway": 0.001,
            "late_frames": 1,
            "joint_noise": 0.0002,
            "joint_resolution": 0.0005,
        },
        "sensor": {
            "noise": 4.0,
            "flicker": 0.03,
            "vignette": 0.0,
            "jpeg_quality": 70,
            "blur": 0.0,
            "readout": 0.0,
            "distortion": (0.0, 0.0),
            "shadows": False,
            "sway": 0.0,
            "late_frames": 1,
            "joint_noise": 0.0,
            "joint_resolution": 0.0,
        },
    }


def test_a_realistic_camera_is_noisy_and_sways_before_what_rests():
    world = SimWorld("planar", seed=2, realism="realistic", device="cpu")
    for _ in range(60):
        world.step()
    point = world.track_point((20, 20))  # of the wall
    images, places = [], []
    for _ in range(4):
        world.step()
        images.append(world.frame().rgb.astype(float).mean(axis=-1))
        places.append(world.project(point))
    images = [image * images[0].mean() / image.mean() for image in images]  # without flicker
    noise = np.median(np.abs(np.diff(images, axis=0))) / 0.6745 / np.sqrt(2)  # the standard deviation of normal noise
    assert 2.0 < noise < 5.0  # levels of 255; the compression alone makes less than 1.5
    assert 0.05 < np.hypot(*np.ptp(places, axis=0)) < 5.0


@pytest.mark.parametrize(("one", "other"), [((0, 1), (0, 0)), ((1, 0), (0, 0))])
def test_noise_of_two_worlds_and_of_two_seeds_has_nothing_in_common(one, other):
    def noise(seed, number):
        options = {"seed": seed, "worlds": 2, **SIZE}
        noisy, clean = (SimWorld("planar", realism=realism, **options) for realism in (Realism(noise=5.0), False))
        return (noisy.frame().rgb.astype(float) - clean.frame().rgb)[number]

    assert abs(np.corrcoef(noise(*one).ravel(), noise(*other).ravel())[0, 1]) < 0.1


def test_worlds_of_a_batch_are_degraded_apart():
    world = SimWorld("planar", seed=2, worlds=2, realism=Realism(noise=5.0, sway=0.01), **SIZE)
    world.step([0.02, 0.02, 0.02])
    rgb, flow, mask = world.frame().rgb.astype(int), world.true_flow(), world.robot_mask()
    assert np.abs(rgb[0] - rgb[1]).mean() > 1
    scenery = ~mask[0] & ~mask[1]
    assert np.abs(flow[0] - flow[1])[scenery].max() > 0.01


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_gpu_exposes_as_a_cpu_does():
    options = {"blur": 0.3, "readout": 0.5, "distortion": (-0.1, 0.02), "shadows": True, "sway": 0.003}
    realism = Realism(noise=2.0, vignette=0.3, flicker=0.05, **options)
    here, there = (
        SimWorld("arm", seed=2, device=device, height=48, width=64, realism=realism) for device in ("cpu", "cuda:0")
    )
    for world in (here, there):
        for _ in range(4):
            world.step([0.02, -0.02, 0.03, 0.02])
    off = np.abs(here.frame().rgb.astype(float) - there.frame().rgb)
    assert off.mean() < 0.5
    np.testing.assert_allclose(np.percentile(np.abs(here.true_flow() - there.true_flow()), 98), 0.0, atol=1e-2)


def test_reading_noise_is_as_strong_as_asked():
    world = make(joint_noise=0.01)
    read = []
    for _ in range(300):
        world.step()
        read.append(world.joints()[0])
    np.testing.assert_allclose(np.std(read, axis=0), 0.01, rtol=0.15)


def test_readings_are_rounded():
    world = make(joint_resolution=0.01)
    for step in STEPS:
        world.step(step)
        read = world.joints()[0] / 0.01
        np.testing.assert_allclose(read, np.rint(read), atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"noise": -1}, "noise is -1"),
        ({"flicker": 2.0}, "flicker"),
        ({"jpeg_quality": 0}, "jpeg_quality"),
        ({"jpeg_quality": 70.5}, "whole number"),
        ({"late_frames": 1.5}, "late_frames"),
        ({"vignette": np.nan}, "vignette"),
        ({"blur": 1.5}, "blur is 1.5; expected a number from 0 to 1"),
        ({"readout": -0.1}, "readout"),
        ({"distortion": 0.1}, "two finite numbers"),
        ({"distortion": (0.1, np.inf)}, "two finite numbers"),
        ({"shadows": 1}, "shadows is 1; expected True or False"),
        ({"joint_noise": "much"}, "joint_noise"),
    ],
)
def test_refuses_options_out_of_range(options, message):
    with pytest.raises(DenseVSError, match=message):
        Realism(**options)


def test_refuses_what_is_no_realism():
    with pytest.raises(DenseVSError, match="realism is 'much'; expected True, False, one of 'realistic', 'sensor'"):
        SimWorld("planar", realism="much", **SIZE)


def learned(late, **options):
    """Loop and median error of J after 8 s of babbling with readings that many frames late, and no body that helps."""
    realism = Realism(late_frames=late)
    world = SimWorld("planar", seed=5, device="cpu", height=120, width=160, realism=realism)
    experiment = ReachingExperiment(world, seed=5, babble_seconds=8.0, body_model=False, **options)
    return experiment.loop, experiment.learn().median


def test_the_loop_finds_how_late_readings_are_and_learns_as_well():
    on_time, least = learned(0)
    assert on_time.joint_delay == 0.0
    _, unaware = learned(1, joint_delay=0.0)
    for late in (1, 2):
        loop, error = learned(late)
        assert loop.joint_delay * 30 == pytest.approx(late, abs=0.3)
        assert error < min(1.3 * least, 0.8 * unaware)
