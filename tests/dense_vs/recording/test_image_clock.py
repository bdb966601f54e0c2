"""Stamps that a recorder made jitter, against the camera's own."""

import numpy as np
import pytest

from dense_vs import DenseVSError
from dense_vs.recording.image_clock import even_stamps, smoothed


@pytest.mark.parametrize("seed", range(4))
def test_a_recorder_twice_as_fast_as_the_camera(seed):
    rng = np.random.default_rng(seed)
    taken = np.arange(200) / 15.1 + 0.02
    written = np.unique(np.ceil((taken + rng.uniform(0, 0.03, 200)) * 30) / 30)
    assert len(written) == 200
    even = even_stamps(written)
    assert np.abs(np.diff(even) - 1 / 15.1).max() < 0.15 / 15.1
    assert np.abs(np.diff(written) - 1 / 15.1).max() > 0.4 / 15.1
    assert np.ptp(even - taken) < 0.02


def test_a_gap_stays_a_gap():
    times = np.concatenate([np.arange(50) / 15, 10 + np.arange(50) / 15])
    np.testing.assert_allclose(even_stamps(times), times, atol=1e-6)


def test_smoothed_keeps_lines_and_lowers_noise():
    rng = np.random.default_rng(0)
    line = np.linspace(0, 1, 100)[:, None]
    np.testing.assert_allclose(smoothed(line, 1.5)[10:-10], line[10:-10], atol=1e-12)
    noise = rng.normal(0, 1, (2000, 3))
    assert smoothed(noise, 1.5).std() < 0.5
    np.testing.assert_array_equal(smoothed(noise, 0), noise)


@pytest.mark.parametrize("times", [[0.0], [0.0, 1.0, 1.0], [0.0, np.nan]])
def test_bad_times(times):
    with pytest.raises(DenseVSError):
        even_stamps(np.array(times))
