"""The search for delays and offsets, step by step: curves, joint steps, predictions left out one by one, windows."""

from itertools import pairwise

import numpy as np
import pytest

from dense_vs import JointLog
from dense_vs.recording import clock_offset, joint_delay
from dense_vs.recording.clock_offset import ClockOffset, MotionSamples, find_clock_offset
from dense_vs.recording.joint_delay import (
    DelayCurve,
    babbling_curve,
    even_joints,
    find_changed_delay,
    find_joint_delay,
    joint_steps,
    unexplained_by_constant_jacobian,
    unexplained_by_jacobian,
    unexplained_components,
)


@pytest.mark.parametrize("true", [0.031, 0.05, -0.012])
def test_the_best_delay_is_the_least_of_a_parabola(true):
    delays = np.arange(-10, 11) * 0.01
    curve = DelayCurve(delays, 3.0 + 7 * (delays - true) ** 2)
    assert curve.best == pytest.approx(true, abs=1e-12)
    assert curve.least == pytest.approx(3.0 + 7 * np.min((delays - true) ** 2))
    assert curve.at(0.025) == pytest.approx(3.0 + 3.5 * ((0.02 - true) ** 2 + (0.03 - true) ** 2))
    assert DelayCurve(delays, delays).best == delays[0]  # at the border there is no parabola
    assert DelayCurve(delays, -delays).best == delays[-1]
    assert DelayCurve(delays, np.zeros(21)).best == delays[0]
    flat = np.abs(delays) + 0.0
    flat[9:12] = 0.0
    assert DelayCurve(delays, flat).best == pytest.approx(delays[9] + 0.005)  # as low at the next one


def test_joint_steps_are_between_the_stamps_and_zero_outside_the_log():
    times = np.arange(0.0, 2.01, 0.1)
    positions = np.stack([times**2, 3 * times], axis=1)
    pairs, delays = np.array([[0.5, 0.7], [1.8, 1.9], [2.5, 2.6]]), np.array([0.0, 0.1, -3.0])
    found = joint_steps(pairs, delays, times, positions)
    assert found.shape == (3, 3, 2)
    np.testing.assert_allclose(found[0], [[0.24, 0.6], [0.37, 0.3], [0, 0]], atol=1e-9)
    np.testing.assert_allclose(found[1], [[0.28, 0.6], [0.39, 0.3], [0, 0]], atol=1e-9)
    np.testing.assert_array_equal(found[2], 0.0)


def test_what_the_other_pairs_predict_is_left_out_one_by_one():
    """Ridge regression from all pairs but one, made anew for each."""
    rng = np.random.default_rng(0)
    steps, flow = rng.normal(size=(2, 7, 3)), rng.normal(size=(7, 5))
    found, components = unexplained_by_constant_jacobian(steps, flow @ flow.T), unexplained_components(steps, flow)
    for k in range(2):
        S = steps[k]
        ridge = 0.01 * np.trace(S @ S.T)
        total = np.zeros(5)
        for out in range(7):
            rest = np.arange(7) != out
            J = np.linalg.solve(S[rest].T @ S[rest] + ridge * np.eye(3), S[rest].T @ flow[rest])
            total += (flow[out] - S[out] @ J) ** 2
        assert found[k] == pytest.approx(total.sum(), rel=1e-6)
        np.testing.assert_allclose(components[k], total, rtol=1e-6)


def test_the_share_that_j_does_not_predict_is_a_mean_over_motions():
    rng = np.random.default_rng(1)
    steps = rng.normal(size=(3, 4, 2))
    flows = [rng.normal(size=(p, 2)) for p in (3, 5, 2, 4)]
    jacobians = [rng.normal(size=(len(flow), 2, 2)) for flow in flows]
    found = unexplained_by_jacobian(steps, flows, jacobians)
    for k in range(3):
        shares = []
        for m, (flow, J) in enumerate(zip(flows, jacobians, strict=True)):
            predicted = np.array([one @ steps[k, m] for one in J])
            energy = np.mean(flow**2) + np.mean(predicted**2) + 0.09
            shares.append(np.mean((flow - predicted) ** 2) / energy)
        assert found[k] == pytest.approx(np.mean(shares))


def test_joints_are_smoothed_and_in_units_of_their_usual_change():
    times = np.arange(0.0, 4.0, 0.02)
    positions = np.stack([np.sin(3 * times), np.full(len(times), 7.0), 1000 * np.sin(3 * times) + 5e4], axis=1)
    fine, joints = even_joints(times, positions)
    np.testing.assert_allclose(np.diff(fine), 1 / 240)
    assert joints.shape == (len(fine), 2)  # without the one that stands still
    step = joints[24:] - joints[:-24]
    np.testing.assert_allclose(np.sqrt(np.mean(step**2, axis=0)), 1.0, rtol=1e-9)
    np.testing.assert_allclose(joints[:, 1] - joints[0, 1], joints[:, 0] - joints[0, 0], atol=1e-6)
    # A slow sine keeps its size, a step becomes one of 1/30 s: half-way up at its middle, 84 % a deviation later.
    true = np.sin(3 * fine)
    ratio = np.std(joints[100:-100, 0]) / np.std(true[100:-100])
    np.testing.assert_allclose(joints[100:-100, 0] / ratio, true[100:-100], atol=0.01)
    sharp = np.where(times < 2.0, 0.0, 1.0)[:, None]
    fine, joints = even_joints(times, sharp)
    up = joints[:, 0] / joints[-1, 0]
    middle = fine[np.searchsorted(up, 0.5)]
    assert middle == pytest.approx(1.99, abs=0.006)
    assert up[np.searchsorted(fine, middle + 1 / 30)] == pytest.approx(0.84, abs=0.03)
    few, nothing = even_joints(np.array([0.0, 0.05]), np.array([[0.0], [1.0]]))
    assert len(few) <= 24
    assert nothing.shape[1] == 0  # too short to tell


def babbled(delay, seconds=2.5, seed=2, fps=30.0):
    """Flow of three places with a constant J, and readings that are so much behind the images."""
    rng = np.random.default_rng(seed)
    J = rng.normal(0, 60, (6, 2))

    def joints(t):
        return np.stack([0.2 * np.sin(5 * t) + 0.05 * np.sin(17 * t), 0.2 * np.cos(7 * t + 1)], axis=-1)

    stamps = np.arange(0, seconds, 1 / fps) + 1.0
    pairs = np.stack([stamps[:-1], stamps[1:]], axis=1)
    flow = (joints(pairs[:, 1]) - joints(pairs[:, 0])) @ J.T
    times = np.arange(0.0, seconds + 2.0, 0.01)
    return flow, pairs, times, joints(times - delay)


def told(*seen):
    return find_joint_delay([babbling_curve(*seen, 1 / 30)], 1 / 30)


@pytest.mark.parametrize("frames", [0.0, 0.35, 0.5, 1.0, 2.5, -1.5])
def test_a_delay_counts_from_two_fifths_of_a_frame_on(frames):
    found = told(*babbled(frames / 30))
    assert found == pytest.approx(frames / 30 if abs(frames) >= 0.4 else 0.0, abs=0.08 / 30)
    assert (found == 0.0) == (abs(frames) < 0.4)


@pytest.mark.parametrize("at", [8, 14])
def test_a_delay_that_explains_hardly_more_does_not_count(monkeypatch, at):
    """At least four percent of what is left by others, none among them."""
    flow, pairs, times, joints = babbled(1.0 / 30)
    for share, counts in ((0.965, False), (0.955, True)):

        def unexplained(steps, flow, share=share):
            by_delay = np.where(np.arange(len(steps)) == at, share, 1.0)
            noise = len(flow) * 0.15**2
            return by_delay[:, None] * (5.0 + noise) * np.ones(flow.shape[1]) - noise

        monkeypatch.setattr(joint_delay, "unexplained_components", unexplained)
        found = told(flow, pairs, times, joints)
        assert (found is not None) == counts
        if counts:  # tried every quarter of a frame from two frames before on
            assert found == pytest.approx((-2 + at / 4) / 30)


@pytest.mark.parametrize("frames", [0.0, 1.0, -1.5])
def test_what_the_joints_do_not_move_does_not_decide(frames):
    """A small robot before a wall on which the flow fails, with a hundred times its energy."""
    flow, pairs, times, joints = babbled(frames / 30)
    rng = np.random.default_rng(4)
    small = np.tile(flow, (1, 5)) + 0.5 * flow.std() * rng.normal(size=(len(flow), 30))
    wall = rng.normal(0, 10 * flow.std() * np.sqrt(30 / 1170), (len(flow), 1170))
    everything = np.hstack([wall, small])[:, rng.permutation(1200)]
    found = told(everything, pairs, times, joints)
    assert found == pytest.approx(frames / 30, abs=0.2 / 30)


def test_places_that_hardly_move_are_not_taken_for_the_best_explained():
    """Nothing is left unexplained where there is nothing; what moves by tenths of a pixel tells a delay."""
    flow, pairs, times, joints = babbled(1.0 / 30)
    still = 1e-3 * np.roll(flow, 2, axis=0)[:, np.arange(2000) % 6]  # which another delay explains exactly
    seen = np.tile(flow, (1, 20)) + 0.4 * flow.std() * np.random.default_rng(3).normal(size=(len(flow), 120))
    found = told(np.hstack([still, seen]), pairs, times, joints)
    assert found == pytest.approx(1 / 30, abs=0.15 / 30)


def changed(frames, motions=4, size=60.0, noise=0.0, fps=30.0):
    """Motions with J known at four places, the readings so many frames behind."""
    rng = np.random.default_rng(3)

    def joints(t):
        return np.stack([0.3 * np.sin(6 * t), 0.25 * np.cos(9 * t)], axis=-1)

    stamps = 1.0 + np.arange(motions + 1) / fps
    pairs = np.stack([stamps[:-1], stamps[1:]], axis=1)
    jacobians = [rng.normal(0, size, (4, 2, 2)) for _ in range(motions)]
    moved = joints(pairs[:, 1]) - joints(pairs[:, 0])
    flows = [J @ step + noise * rng.normal(size=(4, 2)) for J, step in zip(jacobians, moved, strict=True)]
    times = np.arange(0.0, 3.0, 0.005)
    return flows, jacobians, pairs, times, joints(times - frames / fps)


@pytest.mark.parametrize(("frames", "found"), [(-4.0, -4.0), (2.0, 2.0), (0.7, 0.0), (0.9, 0.9), (-0.9, -0.9)])
def test_a_changed_delay_counts_from_three_quarters_of_a_frame_on(frames, found):
    answer = find_changed_delay(*changed(frames), now=-1.5 / 30 if abs(frames) < 1 else 0.0, frame_time=1 / 30)
    assert answer == pytest.approx(found / 30, abs=0.15 / 30)


def test_no_change_is_found_where_too_little_tells():
    now = {"now": 0.0, "frame_time": 1 / 30}
    assert find_changed_delay(*changed(-3.0, motions=3), **now) is None
    assert find_changed_delay(*changed(-3.0), **now) is not None
    assert find_changed_delay(*changed(-3.0), now=-0.1, frame_time=1 / 30) is None  # it is that already
    assert find_changed_delay(*changed(-3.0, noise=3.0), **now) is None  # another delay leaves too much
    assert find_changed_delay(*changed(-3.0, size=1.0), **now) is None  # joints hardly move the image


# Offsets of whole recordings.


def samples_of(offset, seconds=20.0, seed=4, gap=None, speed=1.0):
    """Coarse flow of two joints' motion, a J that changes slowly, and the log whose clock is ahead by ``-offset``."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 6, 6)

    def joints(time):
        t = speed * time
        return np.stack([np.sin(3 * t + phases[0]) + 0.5 * np.sin(7.3 * t + phases[1]),
                         np.cos(4.1 * t + phases[2]) + 0.4 * np.sin(9.7 * t + phases[3])], axis=-1)  # fmt: skip

    stamps = np.arange(0, seconds, 1 / 15)
    J = rng.normal(0, 2, (40, 2))
    samples = MotionSamples()
    for a, b in pairwise(stamps):
        if gap and gap[0] < b < gap[1]:
            continue
        samples.pairs.append((a, b))
        samples.flows.append((1 + 0.2 * np.sin(0.1 * a)) * J @ (joints(b) - joints(a)) + 0.02 * rng.normal(size=40))
    times = np.arange(-1, seconds + 1, 0.02)
    return samples, JointLog(("a", "b"), times - offset, joints(times))


@pytest.mark.parametrize("offset", [0.13, -0.21, 0.0])
def test_an_offset_is_found_with_its_certainty(offset):
    samples, log = samples_of(offset)
    found = find_clock_offset(samples, log)
    assert found.seconds == found.best == pytest.approx(offset, abs=0.01)
    assert (found.confidence, found.drift, found.reason) == (1.0, 0.0, "")
    assert found.error < 0.01
    assert found.middle == pytest.approx(10.0, abs=0.5)
    np.testing.assert_allclose(found.applied(log).times, log.times + found.seconds)


def test_an_offset_is_applied_with_its_drift_about_its_middle():
    log = JointLog(("a",), np.array([0.0, 10.0, 30.0]), np.zeros((3, 1)))
    found = ClockOffset(0.5, 1.0, 0.01, drift=0.01, middle=20.0).applied(log)
    np.testing.assert_allclose(found.times, [0.5 - 0.195, 10.5 - 0.095, 30.5 + 0.105])
    assert found.names == ("a",)


def test_what_cannot_tell_an_offset():
    samples, log = samples_of(0.1)
    still = JointLog(log.names, log.times, np.zeros_like(log.positions))
    assert find_clock_offset(samples, still).reason == "no joint moves"
    late = JointLog(log.names, log.times + 100.0, log.positions)
    assert find_clock_offset(samples, late).reason.startswith("fewer than 8 images")
    for factor, told in ((0.9, True), (1.1, False)):
        faint = MotionSamples(samples.pairs)
        largest = max(np.sqrt(np.mean(flow**2)) for flow in samples.flows)
        faint.flows = [flow * factor * 0.02 / largest for flow in samples.flows]
        assert (find_clock_offset(faint, log).reason == "nothing moves in the images") == told
    few = MotionSamples(samples.pairs[:90:9], samples.flows[:90:9])
    assert find_clock_offset(few, log).reason.startswith("no second and a half")
    other, _ = samples_of(0.0, seed=11, speed=1.37)
    found = find_clock_offset(other, log)  # of another motion
    assert "does not tell it well enough" in found.reason
    assert found.seconds == found.drift == 0.0
    assert found.confidence < 0.6 or found.error > 0.04


def test_windows_overlap_by_half_and_have_eight_pairs_at_least(monkeypatch):
    samples, log = samples_of(0.0, seconds=6.0, gap=(2.0, 3.2))
    pairs, motion = np.array(samples.pairs), np.stack(samples.flows)
    times, joints = even_joints(log.times, log.positions)
    curves, middles = clock_offset._window_curves(pairs, motion, times, joints, np.array([-0.05, 0.0, 0.05]))
    expected, start = [], pairs[0, 0]
    while start < pairs[-1, 1]:
        inside = pairs[(pairs[:, 0] >= start) & (pairs[:, 1] <= start + 1.6)]
        if len(inside) >= 8:
            expected.append((inside[0, 0] + inside[-1, 1]) / 2)
        start += 0.8
    np.testing.assert_allclose(middles, expected)
    assert curves.shape == (len(expected), 3)
    assert (curves.argmin(axis=1) == 1).all()


def test_a_joint_that_predicts_little_hardly_counts():
    """A shivering joint as a third one leaves the curves nearly as they are."""
    samples, log = samples_of(0.0, seconds=8.0)
    pairs, motion = np.array(samples.pairs), np.stack(samples.flows)
    times, joints = even_joints(log.times, log.positions)
    shiver = np.random.default_rng(6).normal(size=(len(joints), 1))
    delays = np.arange(-4, 5) * 0.05
    plain, _ = clock_offset._window_curves(pairs, motion, times, joints, delays)
    more, _ = clock_offset._window_curves(pairs, motion, times, np.hstack([joints, shiver]), delays)
    np.testing.assert_allclose(more.sum(axis=0), plain.sum(axis=0), rtol=0.05)


def drifting(rate, seconds=120.0, windows=100):
    """Curves whose least goes from one window to the next."""
    delays = np.arange(-40, 41) * 0.01
    middles = np.linspace(0, seconds, windows)
    least = 0.1 + rate * (middles - seconds / 2)
    curves = (delays - least[:, None]) ** 2
    rng = np.random.default_rng(7)
    return curves, middles, delays, 0.1, [rng.integers(0, windows, windows // 2) for _ in range(50)]


@pytest.mark.parametrize("rate", [0.0, 0.0005, -0.001])
def test_a_drift_over_minutes_is_found(rate):
    assert clock_offset._drift(*drifting(rate)) == pytest.approx(rate, abs=1e-5)
    assert clock_offset._drift(*drifting(rate, seconds=59.0)) == 0.0
    assert (clock_offset._drift(*drifting(rate, seconds=61.0)) != 0.0) == (rate != 0.0)


def test_a_drift_within_its_error_is_none():
    curves, middles, delays, best, draws = drifting(0.0005)
    noisy = curves.copy()
    rng = np.random.default_rng(8)
    for row in noisy:
        row[:] = (delays - rng.normal(0.1, 0.15)) ** 2
    assert clock_offset._drift(noisy, middles, delays, best, draws) == 0.0
    small = drifting(0.014 / 120)  # not three times the least error, 5 ms over the whole
    assert clock_offset._drift(*small) == 0.0
    assert clock_offset._drift(*drifting(0.018 / 120)) != 0.0


def test_flow_is_gathered_coarsely_and_gaps_are_left_out():
    rng = np.random.default_rng(9)
    wide = rng.integers(0, 255, (60, 82)).repeat(5, axis=0).repeat(5, axis=1).astype(np.uint8)
    samples = MotionSamples()
    samples.add(wide[:, 10:330], 1.0)
    assert samples.pairs == []
    samples.add(wide[:, 14:334], 1.1)
    assert samples.pairs == [(1.0, 1.1)]
    flow = samples.flows[0].reshape(18, 20, 2)
    assert flow.shape[:2] == (150 // 8, 160 // 8)
    # The picture went 4 px to the left at twice the width, which is seen from the present image to the one before.
    np.testing.assert_allclose(np.median(flow, axis=(0, 1)), [2.0, 0.0], atol=0.2)
    samples.restart()
    samples.add(wide[:, 10:330], 2.0)
    assert len(samples.pairs) == 1
    samples.add(wide[:, 12:332], 2.1)
    assert samples.pairs[1] == (2.0, 2.1)


def test_stamps_of_any_clock_give_the_same_joints():
    """Those of Unix time are a billion times the length of a log."""
    _, _, times, joints = babbled(0.0)
    fine, smooth = even_joints(times, joints)
    of_unix, same = even_joints(times + 1.7e9, joints)
    assert len(of_unix) == len(fine)
    np.testing.assert_allclose(of_unix - 1.7e9, fine, atol=1e-4)
    np.testing.assert_allclose(same, smooth, atol=2e-3)
