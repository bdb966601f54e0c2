"""Flow around a point alone is that of the whole image there, wherever the point is, and nothing elsewhere."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from dense_vs import FlowEstimator
from dense_vs.pipeline.frame_pipeline import BODY_FLOW
from dense_vs.point_servo.following import AROUND, PointFlow

HEIGHT, WIDTH = 240, 400
MOVED = 3, -2  # px, x and y


@pytest.fixture(scope="module")
def images():
    texture = gaussian_filter(np.random.default_rng(0).normal(size=(HEIGHT, WIDTH)), 2.0, mode="wrap")
    before = np.clip(128 + 40 * texture / texture.std(), 0, 255).astype(np.uint8)
    return before, np.roll(before, MOVED[::-1], axis=(0, 1))


@pytest.mark.parametrize("point", [(200, 120), (30, 30), (0, 239), (399, 0), (-50, 700), (123.4, 88.8)])
def test_flow_at_a_point(images, point):
    flow = PointFlow(HEIGHT, WIDTH)(*images, np.array(point, float))
    x, y = np.clip(np.rint(point).astype(int) + MOVED, 4, (WIDTH - 5, HEIGHT - 5))
    if 20 < x < WIDTH - 20 and 20 < y < HEIGHT - 20:  # what comes into view at the border came from nowhere
        np.testing.assert_allclose(flow[y, x], MOVED, atol=0.1)
        np.testing.assert_allclose(flow[y, x], FlowEstimator(BODY_FLOW, HEIGHT, WIDTH)(*images)[y, x], atol=0.1)
    assert np.abs(flow[y, x]).max() > 0.5


def test_only_the_last_surroundings_have_flow(images):
    find = PointFlow(HEIGHT, WIDTH)
    find(*images, np.array([100.0, 100.0]))
    flow = find(*images, np.array([300.0, 130.0]))
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[130 - AROUND // 2 : 130 + AROUND // 2, 300 - AROUND // 2 : 300 + AROUND // 2] = True
    assert not flow[~expected].any()
    assert (np.abs(flow[expected]).max(axis=1) > 0).mean() > 0.99


def test_an_image_smaller_than_the_surroundings():
    small = np.random.default_rng(1).integers(0, 255, (40, 30)).astype(np.uint8)
    flow = PointFlow(40, 30)(small, small, np.array([5.0, 39.0]))
    assert flow.shape == (40, 30, 2)
    np.testing.assert_array_equal(flow, 0.0)
