"""When a camera counts as moved: at four times the noise of the pixels, neither before nor ten times later."""

import numpy as np
import pytest

NOISE = 0.5  # px of a coordinate; its distances have a median 1.1774 times as large


@pytest.mark.parametrize(("off", "named"), [(0.9, False), (1.1, True), (2.0, True)])
def test_a_camera_is_named_at_four_times_the_noise(ur5, copied, off, named):
    copied.report.pixel_sigma, copied.report.joint_sigma = NOISE, None
    q = ur5.unseen_joints[0]
    pixels = copied.pixels(q[None])[0]
    limit = 4.0 * 1.1774 * NOISE
    pixels[1, :, 0] += off * limit
    change = copied.online().add(q, pixels)
    assert change.camera_errors_px == pytest.approx([0.0, off * limit], abs=1e-6)
    assert change.moved_cameras == ((1,) if named else ())
    assert not change.everything_moved


def test_all_cameras_off_is_no_moved_camera(ur5, copied):
    copied.report.pixel_sigma, copied.report.joint_sigma = NOISE, None
    q = ur5.unseen_joints[0]
    change = copied.online().add(q, copied.pixels(q[None])[0] + 10.0)
    assert change.everything_moved
    assert change.moved_cameras == ()
    assert np.isfinite(change.gradient_norm)
