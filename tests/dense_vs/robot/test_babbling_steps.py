"""Babbling step by step beside its equations, and its pace on either side of every limit."""

import numpy as np
import pytest

from dense_vs import Babbling
from dense_vs.errors import DenseVSError


def reference(seed, joints, rates, amplitude=0.15, tau=0.4, frame=1 / 30):
    """An Ornstein-Uhlenbeck process and its first-order lag, by Euler's method at the given rates.

    A kick is turned toward what the steps so far moved less, by the eigenvectors of their second moments, and stays
    as strong.
    """
    rng, noise, offset, steps = np.random.default_rng(seed), np.zeros(joints), np.zeros(joints), []
    for rate in rates:
        dt = min(rate * frame / tau, 0.5)
        kick = rng.normal(size=joints)
        if steps:
            moments, directions = np.linalg.eigh(np.array(steps).T @ np.array(steps))
            turned = directions @ ((1 - moments / (2 * moments.sum())) ** (2 * joints) * (directions.T @ kick))
            kick = turned / np.linalg.norm(turned) * np.linalg.norm(kick)
        noise = noise - dt * noise + np.sqrt(2 * dt) * kick
        most = 6 * amplitude * min(frame / tau, 0.5)
        wanted = np.clip(offset + dt * (np.sqrt(2) * amplitude * noise - offset), -3 * amplitude, 3 * amplitude)
        step = np.clip(wanted - offset, -most, most)
        offset = offset + step
        steps.append(step)
    return np.array(steps)


@pytest.mark.parametrize(
    "options", [{}, {"amplitude": 0.3, "time_constant": 0.05, "frame_time": 0.7}, {"time_constant": 2.0}]
)
def test_steps_are_those_of_the_process(options):
    babbling = Babbling(3, seed=4, **options)
    named = {"amplitude": "amplitude", "time_constant": "tau", "frame_time": "frame"}
    expected = reference(4, 3, [0.5] * 200, **{named[name]: value for name, value in options.items()})
    steps = np.array([babbling.step() for _ in range(200)])
    np.testing.assert_allclose(steps, expected, atol=1e-9)
    assert babbling.excitation == pytest.approx(np.linalg.eigvalsh(steps.T @ steps)[0])


def test_excursions_are_wider_in_the_middle_of_the_first_ten_seconds():
    babbling = Babbling(2, amplitude=0.1, wide_amplitude=0.3, frame_time=0.05)
    amplitudes = []
    for _ in range(420):
        amplitudes.append(babbling.amplitude)
        babbling.step()
    seconds = np.array([0.0, 3.25, 4.15, 5.0, 7.2, 7.95, 8.7, 9.95, 10.0, 15.0])
    found = np.array(amplitudes)[np.rint(seconds / 0.05).astype(int)]
    np.testing.assert_allclose(found, [0.1, 0.1, 0.2, 0.3, 0.3, 0.2, 0.1, 0.1, 0.1, 0.1], atol=1e-6)


def test_images_that_are_rare_or_dropped_widen_it_when_others_do_and_a_pause_does_not_count():
    babbling = Babbling(2, amplitude=0.1, wide_amplitude=0.3)
    rare, dropped = np.arange(0.0, 4.0, 0.1), np.array([4.5, 6.5])
    after = 6.5 + 1 / 30 + np.arange(0.0, 4.0, 0.2)  # s of babbling, by a clock that went on for 2.01 s meanwhile
    babbled = np.concatenate([rare, dropped, after])
    amplitudes = []
    for time in np.concatenate([rare, dropped, after - 1 / 30 + 2.01]):
        babbling.step(time=time)
        amplitudes.append(babbling.amplitude)  # of the step that follows, by frame_time
    ends = 3.3, 5.0, 7.2, 8.7
    np.testing.assert_allclose(amplitudes, np.interp(babbled + 1 / 30, ends, (0.1, 0.3, 0.3, 0.1)), atol=1e-9)
    assert (max(amplitudes), amplitudes[-1]) == pytest.approx((0.3, 0.1))


def test_times_that_go_back_count_as_one_step():
    babbling, usual = (Babbling(2, wide_amplitude=0.3) for _ in range(2))
    for time in (4.0, 3.0):
        np.testing.assert_array_equal(babbling.step(time=time), usual.step())
    assert babbling.amplitude == usual.amplitude


@pytest.mark.parametrize("time", [np.nan, "soon", True])
def test_a_time_that_is_none_changes_nothing(time):
    babbling, usual = (Babbling(2, seed=3) for _ in range(2))
    with pytest.raises(DenseVSError, match=r"time is .*; expected"):
        babbling.step(np.full((16, 16, 2), 9.0, np.float32), time)
    np.testing.assert_array_equal(babbling.step(), usual.step())


def test_wider_excursions_go_farther_by_steps_that_are_no_longer():
    paths = {}
    for wide in (None, 0.15, 0.45):
        babbling = Babbling(40, seed=3, wide_amplitude=wide)
        steps = np.array([babbling.step() for _ in range(300)])
        assert np.abs(steps).max() <= babbling.largest_step == Babbling(1).largest_step
        paths[wide] = np.cumsum(steps, axis=0)
    np.testing.assert_array_equal(paths[None], paths[0.15])
    np.testing.assert_array_equal(paths[None][:99], paths[0.45][:99])
    assert np.abs(paths[0.45]).max() < 3 * 0.45
    spread = {wide: path[165:216].std() for wide, path in paths.items() if wide}
    assert 2.0 < spread[0.45] / spread[0.15] < 3.5
    ends = {wide: path[-1].std() for wide, path in paths.items() if wide}
    assert ends[0.45] < 1.5 * ends[0.15]


def test_the_largest_step_is_six_deviations_at_full_speed():
    assert Babbling(1).largest_step == pytest.approx(6 * 0.15 * (1 / 30) / 0.4)
    assert Babbling(1, time_constant=0.01).largest_step == pytest.approx(6 * 0.15 * 0.5)


def paced(*fastest, size=(40, 400), max_flow=4.0):
    babbling = Babbling(2, max_flow=max_flow)
    for value in fastest:
        babbling.step(np.full((*size, 2), value, np.float32))
    return babbling.rate


@pytest.mark.parametrize(
    ("flow", "rate"),
    [((4.0,), 0.525), ((4.01,), 0.5 * 4 / 4.01), ((5.0,), 0.4), ((8.0,), 0.25), ((90.0,), 0.25), ((90.0,) * 9, 0.02),
     ((1.0,) * 99, 1.0), ((0.0, 0.0), 0.5 * 1.05**2), ((-5.0,), 0.4), ((np.nan,), 0.525)],
)  # fmt: skip
def test_the_pace_falls_at_once_and_rises_slowly(flow, rate):
    assert paced(*flow) == pytest.approx(rate, rel=1e-6)


def test_no_combination_of_joints_is_left_behind():
    """Over ten seconds at a quarter of the pace: the least excited direction has a third of the most excited one's."""
    shares = []
    for seed in range(30):
        babbling = Babbling(4, seed=seed)
        steps = []
        for _ in range(300):
            babbling.rate = 0.25
            steps.append(babbling.step())
        values = np.linalg.eigvalsh(np.array(steps).T @ np.array(steps))
        shares.append(values[0] / values[-1])
    assert np.median(shares) > 0.3  # 0.22 by chance alone
    assert min(shares) > 0.18  # 0.12


@pytest.mark.parametrize(("share", "slower"), [(0.005, False), (0.02, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_hundredth_of_the_pixels_may_be_faster(share, slower, axis):
    """Every fourth pixel of each row and column is looked at, and both components count."""
    flow = np.zeros((40, 400, 2), np.float32)
    flow[:, : int(share * 400), axis] = 8.0
    babbling = Babbling(2)
    babbling.step(flow)
    assert (babbling.rate < 0.5) == slower
    beside = np.zeros((40, 400, 2), np.float32)
    beside[1::4], beside[:, 1::4] = 99.0, 99.0
    babbling = Babbling(2)
    babbling.step(beside)
    assert babbling.rate > 0.5
