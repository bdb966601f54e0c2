"""Images that say nothing are told from those that do, by what the same camera showed before."""

import cv2
import numpy as np
import pytest

from dense_vs.health import FaultKind, ImageWatch


def textured(seed=0, offset=0):
    rng = np.random.default_rng(0)
    smooth = cv2.resize(rng.normal(127, 30, (40, 60)), (360, 240), interpolation=cv2.INTER_CUBIC)
    noise = np.random.default_rng([seed, 1]).normal(0, 3, smooth.shape)
    return np.clip(np.roll(smooth, offset, axis=1) + noise, 0, 255).astype(np.uint8)


def watched(count=5):
    watch = ImageWatch()
    for seed in range(count):
        assert watch.judge(textured(seed, seed), lambda: 3.0)[1] is None
    return watch


@pytest.mark.parametrize("level", [0, 255, 90])
def test_an_image_without_contrast_is_dark(level):
    plain = np.full((240, 360), level, np.uint8)
    for watch in (watched(), ImageWatch()):
        fault = watch.judge(plain, lambda: 0.0)[1]
        assert fault is not None
        assert fault.kind is FaultKind.DARK
        assert fault.stops
        assert fault.holds
    watch = watched()
    for seed in range(40):
        assert watch.judge(np.random.default_rng(seed).integers(0, 3, (240, 360), dtype=np.uint8), lambda: 3.0)[1]
    assert watch.judge(textured(9), lambda: 3.0)[1] is None


def test_the_same_image_is_frozen_once_the_robot_has_moved():
    watch, image = watched(), textured(7)
    assert watch.judge(image, lambda: 3.0)[1] is None
    for _ in range(4):
        assert watch.judge(image, lambda: 0.1)[1] is None  # a camera that waits for a robot that hardly moves
    faults = [watch.judge(image, lambda: 0.08)[1] for _ in range(60)]
    assert [fault is None for fault in faults[:2]] == [True, False]
    assert all(fault is not None and fault.kind is FaultKind.FROZEN and fault.holds for fault in faults[1:])
    # Now and then one motion, so that a view in which nothing moves is no trap.
    assert 1 <= sum(not fault.stops for fault in faults[1:]) <= 3
    assert watch.judge(textured(8), lambda: 3.0)[1] is None


@pytest.mark.parametrize("share", [0.02, 0.05, 0.1])
def test_single_wrong_pixels_are_repaired_and_told(share):
    watch, image = watched(), textured(7)
    drawn = np.random.default_rng(1).random(image.shape)
    wrong = np.where(drawn < share / 2, 0, np.where(drawn > 1 - share / 2, 255, image)).astype(np.uint8)
    repaired, fault = watch.judge(wrong, lambda: 3.0)
    assert fault is not None
    assert fault.kind is FaultKind.NOISE
    assert not fault.stops
    assert not fault.holds
    before, after = (np.abs(given.astype(float) - image).mean() for given in (wrong, repaired))
    assert after < 0.25 * before
    assert watch.judge(textured(8), lambda: 3.0)[1] is None


def test_an_exposure_that_changes_is_no_fault():
    watch = watched()
    for factor in (0.7, 1.3, 0.4):
        assert watch.judge((textured(3) * factor).clip(0, 255).astype(np.uint8), lambda: 3.0)[1] is None
