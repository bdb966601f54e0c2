"""A world at fault gives what the fault says, for as long as it lasts, and nothing else."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.sims import SimWorld
from dense_vs.sims.engine.faults import FAULTS, FaultInjector
from dense_vs.sims.engine.scene import FRAME_SECONDS

STEP = 0.02


@pytest.fixture
def world():
    return SimWorld("planar", height=48, width=64, seed=1, device="cpu")


def frames(world, injector, count):
    """Images, stamps, readings, and what was true, of frames in which every joint moves."""
    seen = []
    for _ in range(count):
        injector.command(np.full(len(injector.joint_names), STEP))
        image, stamp = injector.read()
        reading, read_at = injector.joints()
        seen.append((image, stamp, reading, read_at, world.frame().rgb, world.time, world.joints()[0]))
    return seen


@pytest.mark.parametrize("fault", ["", *FAULTS])
def test_a_fault_begins_and_ends(world, fault):
    injector = FaultInjector(world, seed=2)
    frames(world, injector, 4)
    if fault:
        assert injector.begin(fault, 4.6 * FRAME_SECONDS, joint=1, at=[30, 20]) == 4.6 * FRAME_SECONDS
    during = frames(world, injector, 4)
    stamps = [stamp for _, stamp, *_ in during]
    assert (np.diff(stamps) > 0).all()
    altered = [not np.array_equal(image, true) for image, _, _, _, true, _, _ in during]
    misread = [np.abs(reading - true).max() > 1e-9 for _, _, reading, _, _, _, true in during]
    of_readings = fault in ("encoder glitch", "stuck encoder", "slipping belt")
    assert any(misread) == of_readings
    assert any(altered) == (fault not in ("", "dropped images", "stuck joint") and not of_readings)
    frames(world, injector, 3)
    for image, stamp, reading, read_at, true, time, q in frames(world, injector, 3):
        assert injector.fault == ""
        np.testing.assert_array_equal(image, true)
        np.testing.assert_allclose(reading, q + injector.slipped, atol=1e-9)
        assert stamp == read_at == time


def test_a_bump_shifts_what_the_camera_shows_while_it_lasts(world):
    injector = FaultInjector(world)
    injector.read()
    assert injector.shift.tolist() == [0, 0]
    injector.begin("bump", 2.6 * FRAME_SECONDS)
    for image, *_, true, _, _ in frames(world, injector, 2):
        x, y = injector.shift
        assert (x, y) == (5, 0)
        np.testing.assert_array_equal(image[:, x:], true[:, :-x])
    frames(world, injector, 2)
    assert injector.shift.tolist() == [0, 0]


def test_flicker_is_as_often_brighter_as_darker(world):
    injector = FaultInjector(world, seed=2)
    injector.begin("flicker")
    true = world.frame().rgb.astype(float)
    dark = true < 255 / 2.2  # stays below white
    shown = np.array([injector.read()[0][dark].mean() for _ in range(60)]) / true[dark].mean()
    assert shown.std() == pytest.approx(0.3, rel=0.25)
    assert shown.mean() == pytest.approx(1.0, abs=0.12)


def test_an_exposure_jump_leaves_a_third_of_the_light(world):
    injector = FaultInjector(world)
    injector.begin("exposure jump")
    np.testing.assert_allclose(injector.read()[0], world.frame().rgb / 3, atol=0.51)


@pytest.mark.parametrize("percent", [2, 10])
def test_half_of_the_salt_and_pepper_is_black_and_half_is_white(world, percent):
    injector = FaultInjector(world, seed=2)
    injector.begin(f"salt and pepper {percent} %")
    shown = np.array([injector.read()[0] for _ in range(20)])
    true = world.frame().rgb
    for level in (0, 255):
        drawn = (shown == level).all(axis=-1) & (true != level).any(axis=-1)
        assert drawn.mean() == pytest.approx(percent / 200, rel=0.2)
    unchanged = (shown == true).all(axis=-1)
    assert unchanged.mean() == pytest.approx(1 - percent / 100, abs=0.02)


def test_a_hand_circles_about_its_place(world):
    injector = FaultInjector(world, seed=2)
    injector.begin("hand", at=[30, 20])
    side, middles, begun, turns = 48 // 5, [], world.time, []
    for image, *_, true, time, _ in frames(world, injector, 30):
        y, x = np.nonzero((image != true).any(axis=-1))
        middles.append([(x.min() + x.max() + 1) / 2, (y.min() + y.max() + 1) / 2])
        turns.append(2 * np.pi * (time - begun))
    away = np.array(middles) - [30, 20]
    assert np.abs(away.mean(axis=0)).max() < 0.6
    np.testing.assert_allclose(np.hypot(*away.T), 0.15 * side, atol=1.3)  # to whole pixels
    np.testing.assert_allclose(away, 0.15 * side * np.column_stack([np.cos(turns), np.sin(turns)]), atol=1.1)


def test_late_images_are_old_and_delayed_ones_say_so(world):
    injector = FaultInjector(world)
    first = frames(world, injector, 4)
    shown = {time: true for *_, true, time, _ in first}
    injector.begin("late images")
    for image, stamp, *_, time, _ in frames(world, injector, 3):
        assert stamp == time
        np.testing.assert_array_equal(image, shown[min(shown, key=lambda t: abs(t - time + 3 * FRAME_SECONDS))])
    injector.begin("delayed images")
    for _, stamp, *_, time, _ in frames(world, injector, 3):
        assert stamp == pytest.approx(time - 3 * FRAME_SECONDS)


def test_a_stuck_joint_stands_and_says_so(world):
    injector = FaultInjector(world)
    injector.begin("stuck joint", joint=1)
    *_, reading, _, _, _, q = frames(world, injector, 10)[-1]
    start = SimWorld("planar", height=48, width=64, seed=1, device="cpu").joints()[0]
    assert abs(q[1] - start[1]) < 0.5 * abs(q[0] - start[0])
    np.testing.assert_array_equal(reading, q)


def test_refuses(world):
    injector = FaultInjector(world)
    with pytest.raises(DenseVSError, match="fault is 'gremlins'; expected one of dropped images, delayed images"):
        injector.begin("gremlins")
    with pytest.raises(DenseVSError, match="seconds is"):
        injector.begin("black image", -1.0)
    with pytest.raises(DenseVSError, match="has 2 worlds; expected 1"):
        FaultInjector(SimWorld("planar", worlds=2, height=48, width=64, device="cpu"))
