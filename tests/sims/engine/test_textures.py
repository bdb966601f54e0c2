"""The painted noise: its band, its contrast, and that seeds differ."""

import numpy as np
import pytest

from dense_vs.sims.engine.textures import BANDS, ROBOT_PAINT, SCENERY_PAINT, band_noise, noise_texture


@pytest.mark.parametrize("shape", [(200, 300), (64, 64), (9, 33)])
def test_noise_is_finite_unit_and_has_no_fine_detail(shape):
    noise = band_noise(np.random.default_rng(0), *shape)
    assert noise.shape == shape
    assert noise.std() == pytest.approx(1.0)
    power = np.abs(np.fft.rfft2(noise)) ** 2
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None])
    assert power[frequency > 1.0 / BANDS[0][0]].sum() < 1e-9 * power.sum()


def test_texture_keeps_its_colour_and_contrast():
    colour = np.array([0.3, 0.5, 0.6])
    for paint in (ROBOT_PAINT, SCENERY_PAINT):
        texture = noise_texture(np.random.default_rng(1), 256, 256, colour, paint)
        assert texture.dtype == np.uint8
        np.testing.assert_allclose(texture.mean(axis=(0, 1)) / 255, colour, atol=0.05)  # compressed towards grey
        assert 0.6 * paint.contrast < texture.std(axis=(0, 1)).mean() / 255 < 1.3 * paint.contrast


def test_other_seeds_give_other_noise():
    first, second = (band_noise(np.random.default_rng(seed), 256, 256) for seed in (1, 2))
    assert abs(np.mean(first * second)) < 0.1
