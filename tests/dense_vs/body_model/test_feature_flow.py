"""Features taken from one image to the next, where they are not quite where they are expected."""

import cv2
import numpy as np
import pytest

from dense_vs.body_model.feature_flow import carried

PLACES = np.stack(np.meshgrid(np.arange(60.0, 140, 20), np.arange(50.0, 110, 20)), axis=-1).reshape(-1, 2)


def texture(seed):
    noise = np.random.default_rng(seed).uniform(0, 255, (160, 200)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def shifted(image, motion):
    return cv2.warpAffine(image, np.array([[1, 0, motion[0]], [0, 1, motion[1]]]), image.shape[::-1])


@pytest.mark.parametrize("off", [(0.0, 0.0), (1.5, -1.0), (5.0, 3.0), (-8.0, 6.0)])
def test_features_are_found_ten_pixels_from_where_they_are_expected(off):
    motion = np.array([6.3, -4.6])
    before = texture(1)
    found, believed = carried(before, shifted(before, motion), PLACES, PLACES + motion + off)
    assert believed.mean() > 0.9
    np.testing.assert_allclose(found[believed], (PLACES + motion)[believed], atol=0.1)


def test_features_of_another_image_are_not_believed():
    _, believed = carried(texture(1), texture(2), PLACES, PLACES)
    assert not believed.any()


def test_features_that_leave_the_image_are_not_believed():
    before = texture(3)
    now = shifted(before, (70.0, 0.0))
    _, believed = carried(before, now, PLACES, PLACES + np.array([70.0, 0.0]))
    assert (believed == (PLACES[:, 0] + 70 < 200 - 4)).all()


def test_no_features_are_none():
    found, believed = carried(texture(1), texture(1), np.zeros((0, 2)), np.zeros((0, 2)))
    assert (found.shape, believed.shape, believed.dtype) == ((0, 2), (0,), bool)
