"""How plain an image is about a point, on images whose gradient is known."""

import numpy as np
import pytest

from dense_vs.point_servo.plainness import plainness


def image(slope):
    """Gray values that rise by ``slope`` a px to the right and down."""
    return np.clip(slope[0] * np.arange(120)[:, None] + slope[1] * np.arange(160), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("slope", [(0, 0), (1, 0), (0, 1), (2, 0)])
@pytest.mark.parametrize("point", [[60.0, 50.0], [60.4, 49.6], [20.0, 20.0]])
def test_it_falls_with_the_median_gradient(slope, point):
    assert plainness(image(slope), np.array(point)) == pytest.approx(np.exp(-np.hypot(*slope) / 5), rel=1e-6)


def test_only_what_is_within_19_px_counts_and_what_is_less_than_half_of_it_does_not():
    gray = np.full((120, 160), 90, np.uint8)
    gray[:, 80:] = 180  # an outline
    assert plainness(gray, np.array([75.0, 60.0])) == pytest.approx(1.0)
    rng = np.random.default_rng(0)
    gray[:] = rng.integers(0, 255, gray.shape)
    away = np.hypot(np.arange(120)[:, None] - 60, np.arange(160) - 75)
    textured = plainness(gray, np.array([75.0, 60.0]))
    assert textured < 0.1
    rest = np.where(away <= 24, gray, 90).astype(np.uint8)
    assert plainness(rest, np.array([75.0, 60.0])) == textured
    assert plainness(np.where(away > 24, gray, 90).astype(np.uint8), np.array([75.0, 60.0])) == pytest.approx(1.0)


@pytest.mark.parametrize("point", [[0.0, 0.0], [159.0, 119.0], [0.4, 118.6]])
def test_at_the_edge_of_the_image_it_is_of_what_is_inside(point):
    assert plainness(image((1, 0)), np.array(point)) == pytest.approx(np.exp(-1 / 5), rel=0.05)
