"""Babbling's excitation: rank N, bounded, reproducible, and no faster than the flow allows."""

import numpy as np
import pytest

from dense_vs import Babbling, DenseVSError


@pytest.mark.parametrize("joints", [1, 4, 7, 12])
@pytest.mark.parametrize("seed", range(3))
def test_excites_every_dimension(joints, seed):
    babbling = Babbling(joints, seed=seed)
    steps = np.array([babbling.step() for _ in range(300)])  # 10 s at 30 fps
    assert np.linalg.matrix_rank(steps, tol=1e-3) == joints
    assert babbling.excitation == pytest.approx(np.linalg.svd(steps)[1].min() ** 2)
    assert np.sqrt(0.01 / babbling.excitation) < 3  # px/rad, what J is known to with r = 0.01 px^2


def test_one_frequency_excites_two_dimensions():
    """What it is there to avoid."""
    t = np.arange(300)[:, None] / 30
    steps = np.diff(np.sin(2 * np.pi * t + np.arange(4)), axis=0)
    assert np.linalg.matrix_rank(steps, tol=1e-9) == 2


def test_stays_near_its_posture():
    babbling = Babbling(5, amplitude=0.1, seed=2)
    path = np.cumsum([babbling.step() for _ in range(4000)], axis=0)
    assert np.abs(path).max() <= 0.3 * (1 + 1e-9)
    np.testing.assert_allclose(path.std(axis=0), 0.1, rtol=0.35)


def test_seed_decides():
    one, same, other = (Babbling(3, seed=seed) for seed in (5, 5, 6))
    steps = [[b.step() for _ in range(10)] for b in (one, same, other)]
    np.testing.assert_array_equal(steps[0], steps[1])
    assert (np.array(steps[0]) != np.array(steps[2])).any()


def test_slows_down_where_the_image_moves_too_fast_and_recovers():
    """Each step moves the image by 200 px/rad; the flow it is shown follows from its own steps."""
    babbling = Babbling(3, seed=1, max_flow=2.0, amplitude=0.3)
    flow, fastest = np.zeros((16, 16, 2), np.float32), []
    for _ in range(600):
        delta = babbling.step(flow)
        flow[...] = 200 * np.abs(delta).sum()
        fastest.append(flow.max())
    assert np.quantile(fastest[100:], 0.9) < 2 * 2.0
    assert np.median(fastest[100:]) > 0.3
    slowest = babbling.rate
    for _ in range(100):
        babbling.step(np.full((16, 16, 2), np.nan, np.float32))  # nothing known to move
    assert babbling.rate > slowest


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"joints": 0}, "joints is 0; expected a whole number of at least 1"),
        ({"joints": 1.5}, "joints is 1.5; expected a whole number"),
        ({"joints": "four"}, "joints is 'four'; expected a whole number"),
        ({"amplitude": 0}, "amplitude is 0; expected a finite number above 0"),
        ({"amplitude": "wide"}, "amplitude is 'wide'; expected a finite number above 0"),
        ({"wide_amplitude": -0.1}, "wide_amplitude is -0.1; expected a finite number above 0"),
        ({"wide_amplitude": 1e7}, "wide_amplitude is 10000000.0; expected"),
        ({"time_constant": -1}, "time_constant is -1; expected"),
        ({"max_flow": float("nan")}, "max_flow is nan; expected"),
        ({"frame_time": float("inf")}, "frame_time is inf; expected"),
    ],
    ids=str,
)
def test_refuses(arguments, message):
    with pytest.raises(DenseVSError, match=message):
        Babbling(**{"joints": 3, **arguments})


def test_steps_stay_finite_up_to_the_largest_amplitude():
    babbling = Babbling(2, seed=1, amplitude=1e6)
    assert np.isfinite(babbling.largest_step).all()
    assert all(np.isfinite(babbling.step(None)).all() for _ in range(20))
    with pytest.raises(DenseVSError, match="amplitude is 1000001"):
        Babbling(2, amplitude=1000001.0)
