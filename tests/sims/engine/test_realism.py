"""Realism changes what is seen and read, as much as it says, and nothing of the truth."""

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.realism import Realism
from dense_vs.sims.papers.dije.reaching import ReachingExperiment

SIZE = {"device": "cpu", "height": 48, "width": 64}
NOTHING = {"noise": 0.0, "flicker": 0.0, "jpeg_quality": None, "late_frames": 0}
STEPS = 0.02 * np.random.default_rng(0).normal(size=(6, 3))


def make(**options):
    return SimWorld("planar", seed=2, realism=Realism(**{**NOTHING, **options}), **SIZE)


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
    ],
)
def test_refuses_options_out_of_range(options, message):
    with pytest.raises(DenseVSError, match=message):
        Realism(**options)


def test_refuses_what_is_no_realism():
    with pytest.raises(DenseVSError, match="realism"):
        SimWorld("planar", realism="much", **SIZE)


def learned(late, **options):
    """Loop and median error of J after 8 s of babbling with readings that many frames late."""
    realism = Realism(**{**NOTHING, "late_frames": late})
    world = SimWorld("planar", seed=5, device="cpu", height=120, width=160, realism=realism)
    experiment = ReachingExperiment(world, seed=5, babble_seconds=8.0, **options)
    return experiment.loop, experiment.learn().median


def test_the_loop_finds_how_late_readings_are_and_learns_as_well():
    on_time, least = learned(0)
    assert on_time.joint_delay == 0.0
    _, unaware = learned(1, joint_delay=0.0)
    for late in (1, 2):
        loop, error = learned(late)
        assert loop.joint_delay * 30 == pytest.approx(late, abs=0.3)
        assert error < min(1.3 * least, 0.8 * unaware)
