"""A loop's target, with depth and without, on an estimator with one J for every place."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_vs.errors import DenseVSError
from dense_vs.point_servo import aim as module
from dense_vs.point_servo.aim import Aim

POINT = np.array([30.0, 20.0])
J = np.array([[[100.0, 0.0], [0.0, 50.0], [0.5, -0.25]]])


def aim(depth=True, value=1.5):
    image = np.full((40, 64), value, np.float32)
    options = SimpleNamespace(depth=depth, width=64)
    return Aim(SimpleNamespace(options=options, depth=image, at=lambda point, depth: J))


def test_a_target_in_the_image():
    one = aim()
    one.at([33.0, 24.0], POINT, None)
    assert one.target.tolist() == [33.0, 24.0]
    assert one.distance(POINT) == 5.0
    assert np.isnan(one.depth)
    one.follow(POINT)
    assert one.depth == pytest.approx(1.5)
    assert one.distance(POINT) == 5.0  # depth is known, and no part of the target


def test_without_a_target_there_is_no_step():
    with pytest.raises(DenseVSError, match=r"no target is set; expected reach\(\)"):
        aim().step(None, POINT, J[0, :2], np.zeros(2), np.zeros(2), np.zeros(2, bool))


@pytest.mark.parametrize(("focal", "scale"), [(None, 64 / 2.0), (80.0, 40.0)])
def test_a_target_in_depth_counts_a_meter_as_one_across_the_image_there(focal, scale):
    """The focal length is the body model's, or an image width, which sees 53 degrees."""
    one = aim()
    body = None if focal is None else SimpleNamespace(focal_length=focal)
    one.at([33.0, 24.0, 2.0], POINT, body)
    assert one.depth == pytest.approx(1.5)  # followed from here on
    assert one.distance(POINT) == pytest.approx(np.hypot(5.0, 0.5 * scale))
    asked = []

    def servo(*given, **named):
        asked.append((given, named))
        return "step"

    moved, q, held = np.array([0.1, 0.2]), np.zeros(2), np.array([False, True])
    assert one.step(servo, POINT, J[0, :2] * 9, moved, q, held) == "step"
    (by, place, target, positions), named = asked[0]
    np.testing.assert_array_equal(by, J[0])
    np.testing.assert_allclose(place, [30 + 10, 20 + 10, 1.5 + 0.05 - 0.05])
    assert target is one.target
    assert positions is q
    assert (named["held"] is held, named["pixels_per_meter"]) == (True, scale)
    one.at([33.0, 24.0], POINT, body)  # and in the image again
    one.step(servo, POINT, J[0, :2] * 9, moved, q, held)
    (by, place, *_), named = asked[1]
    np.testing.assert_array_equal(by, J[0, :2] * 9)
    np.testing.assert_allclose(place, [30 + 90, 20 + 90])
    assert named["pixels_per_meter"] is None


def test_targets_that_cannot_be_leave_the_last_one():
    one = aim()
    one.at([1.0, 2.0], POINT, None)
    for wrong in ([1.0, 2.0, 0.0], [1.0, 2.0, -1.0], [1.0, 2.0, np.nan], [1.0], "there"):
        with pytest.raises(DenseVSError):
            one.at(wrong, POINT, None)
    with pytest.raises(DenseVSError, match="expected 2, an image point"):
        aim(depth=False).at([1.0, 2.0, 1.0], POINT, None)
    with pytest.raises(DenseVSError, match="depth is known at 0"):
        aim(value=0.0).at([1.0, 2.0, 1.0], POINT, None)
    assert one.target.tolist() == [1.0, 2.0]
    one.at([1.0, 2.0, 0.01], POINT, None)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("lost", [True, False])
def test_where_a_point_is_has_to_be_known_in_depth_where_the_target_has_one(monkeypatch, known, lost):
    monkeypatch.setattr(module, "certain", lambda *asked: known and asked == ("tracker", 3.0))
    one = aim()
    one.at([1.0, 2.0, 1.0], POINT, None)
    one._followed.unseen = 15 if lost else 14
    assert one.certain("tracker", 3.0) == (known and not lost)
    one.at([1.0, 2.0], POINT, None)
    assert one.certain("tracker", 3.0) == known


def test_the_depth_goes_along():
    one = aim()
    one.update(POINT, np.array([0.2, 0.0]), None)  # none is followed
    one.follow(POINT)
    one.update(POINT, np.array([0.2, 0.0]), None)
    assert one.depth == pytest.approx(1.6, abs=0.02)
    nothing = aim(value=0.0)
    nothing.follow(POINT)
    assert np.isnan(nothing.depth)
