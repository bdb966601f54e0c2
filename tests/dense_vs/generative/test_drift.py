"""Small changes are followed by gradients of the buffer's loss; noise alone moves nothing."""

import copy

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.generative.learning.online import DRIFTED

SAMPLES = 80


def drifted(arm, what, share):
    """The arm after that share of a drift: what the hand holds slips by 5 mm, or a lens warms up."""
    changed = copy.deepcopy(arm)
    if what == "structure":
        changed.features = arm.features + share * np.array([0.003, -0.004, 0.0])
    else:
        changed.cameras[1].intrinsics = arm.cameras[1].intrinsics * (1 + share * np.array([0.01, 0.01, 0.01, -0.01]))
    return changed


def error_px(model, arm):
    joints, pixels = arm.record(np.random.default_rng(31), 60, noise=0.0)
    return float(np.nanmean(np.linalg.norm(model.pixels(joints) - pixels, axis=-1)))


@pytest.mark.parametrize("what", ["structure", "camera:1"])
def test_a_slow_drift_is_followed(ur5, model, copied, what):
    watch, rng = copied.online(capacity=20), np.random.default_rng(30)
    home, steps = copied.parameters.home[None], 0
    copied.infer_joints(copied.pixels(home), near=home)
    copied.infer_poses(copied.pixels(home))
    for number in range(SAMPLES):
        joints, pixels = drifted(ur5.arm, what, (number + 1) / SAMPLES).record(rng, 1)
        change = watch.add(joints[0], pixels[0])
        assert not change.moved_cameras
        before = copied.parameters
        ratio = watch.follow(what)
        assert (copied.parameters is not before) <= (ratio > DRIFTED)
        steps += copied.parameters is not before
    end = drifted(ur5.arm, what, 1.0)
    assert steps >= 3
    assert error_px(model, end) > 1.2
    assert error_px(copied, end) < 0.5 * error_px(model, end)
    # What is inferred is inferred with the model as it is now.
    np.testing.assert_allclose(copied.infer_joints(copied.pixels(home), near=home), home, atol=1e-5)
    np.testing.assert_allclose(copied.infer_poses(copied.pixels(home)), np.eye(4)[None], atol=1e-5)


@pytest.mark.parametrize("what", ["structure", "camera:0"])
def test_noise_moves_nothing(ur5, copied, what):
    watch, before = copied.online(capacity=20), copied.parameters
    for joints, pixels in zip(ur5.unseen_joints, ur5.unseen_pixels, strict=True):
        watch.add(joints, pixels)
        assert 0 < watch.follow(what) < DRIFTED
    assert copied.parameters is before


def test_what_cannot_be_followed(ur5, copied):
    watch = copied.online()
    with pytest.raises(DenseVSError, match="the buffer is empty"):
        watch.follow("structure")
    watch.add(ur5.unseen_joints[0], ur5.unseen_pixels[0])
    for what in ("camera:2", "camera:x", "camera:", "base", None):
        with pytest.raises(DenseVSError, match="expected 'structure' or 'camera:I', I below 2"):
            watch.follow(what)
    for rate in (0.0, 1.5, np.nan, "1"):
        with pytest.raises(DenseVSError, match="rate"):
            watch.follow("structure", rate)
    watch.ignored.add(1)
    with pytest.raises(DenseVSError, match="camera 1 has moved"):
        watch.follow("camera:1")
    watch.follow("camera:0")
