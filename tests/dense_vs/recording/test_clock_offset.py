"""The offset between camera and joints, on simulated robots whose offset is known."""

import itertools

import numpy as np
import pytest

from dense_vs import JointLog
from dense_vs.flow.estimator import to_gray
from dense_vs.recording import MotionSamples, clock_offset, find_clock_offset
from dense_vs.robot.babbling import Babbling

FRAMES = 100


@pytest.fixture(scope="module")
def simulated():
    """Image motion of four seconds of an arm, and its joints."""
    pytest.importorskip("mujoco", reason="simulated robots need MuJoCo")
    from dense_vs.sims import SimWorld

    world = SimWorld("arm", seed=2, height=120, width=160, device="cpu", threads=1)
    low, high = world.joint_limits.T
    babbling = Babbling(len(world.joint_names), seed=2)
    samples, times, positions = MotionSamples(), [], []
    for _ in range(FRAMES):
        q = world.joints()[0]
        world.step(np.clip(q + babbling.step(), low, high) - q)
        then, past = world.joint_history()
        times.append(then)
        positions.append(past)
        samples.add(to_gray(world.frame().rgb), world.time)
    times, positions = np.concatenate(times), np.concatenate(positions)
    fresh = np.append(True, np.diff(times) > 0)
    return samples, JointLog(tuple(world.joint_names), times[fresh], positions[fresh])


@pytest.mark.parametrize("offset", [-0.3, -0.11, 0.0, 0.047, 0.2, 0.3])
def test_known_offsets(simulated, offset):
    samples, log = simulated
    found = find_clock_offset(samples, log.shifted(-offset))
    assert found.seconds == pytest.approx(offset, abs=0.005)
    assert found.confidence > 0.9
    assert found.error < 0.005
    assert found.reason == ""
    np.testing.assert_allclose(found.applied(log.shifted(-offset)).times, log.times, atol=0.005)


def test_units_and_idle_joints_change_nothing(simulated):
    samples, log = simulated
    random = np.random.default_rng(0)
    scaled = log.positions * np.array([1e3, 1e-3, 57.3, 1.0])
    idle = np.column_stack([np.full(len(log.times), 0.4), 1e-4 * random.normal(size=len(log.times))])
    wider = JointLog((*log.names, "still", "shivers"), log.times, np.column_stack([scaled, idle]))
    plain, other = find_clock_offset(samples, log), find_clock_offset(samples, wider)
    assert other.seconds == pytest.approx(plain.seconds, abs=0.002)


def test_quantized_noisy_and_slow_readings(simulated):
    samples, log = simulated
    random = np.random.default_rng(1)
    ticks = np.arange(log.times[0], log.times[-1], 1 / 30) + 0.003
    rough = np.round(log.at(ticks[:-1]) / 0.002) * 0.002 + random.normal(0, 5e-4, (len(ticks) - 1, len(log.names)))
    found = find_clock_offset(samples, JointLog(log.names, ticks[:-1] - 0.15, rough))
    assert found.seconds == pytest.approx(0.15, abs=0.005)


def test_joints_of_another_motion_are_not_believed(simulated):
    samples, log = simulated
    other = JointLog(log.names, log.times, log.positions[::-1, ::-1].copy())
    found = find_clock_offset(samples, other)
    assert found.seconds == 0
    assert "does not tell" in found.reason


def test_no_motion_no_offset(simulated, monkeypatch):
    samples, log = simulated
    still = JointLog(log.names, log.times, np.zeros_like(log.positions))
    assert find_clock_offset(samples, still).reason == "no joint moves"
    frozen = MotionSamples()
    for k in range(60):
        frozen.add(np.full((60, 80), 90, np.uint8), k / 30)
    assert find_clock_offset(frozen, log).reason == "nothing moves in the images"
    # As likely at every offset.
    monkeypatch.setattr(clock_offset, "_window_curves", lambda *given: (np.ones((5, len(given[-1]))), np.arange(5.0)))
    assert "no second and a half" in find_clock_offset(samples, log).reason
    monkeypatch.setattr(clock_offset, "_window_curves", lambda *given: (np.zeros((0, len(given[-1]))), np.zeros(0)))
    assert "no second and a half" in find_clock_offset(samples, log).reason
    monkeypatch.undo()
    apart = find_clock_offset(samples, log.shifted(100.0))
    assert apart.seconds == 0
    assert "within the joint log" in apart.reason


def test_drift_over_minutes():
    """Flow that is a linear function of the joints, and a log whose clock runs 0.5 ms a second fast."""
    random = np.random.default_rng(3)
    seconds, rate = 100.0, 5e-4
    times = np.arange(0, seconds, 0.01)
    kernel = np.hanning(60)
    joints = np.stack([np.convolve(random.normal(size=len(times)), kernel, "same") for _ in range(3)], axis=1)
    images = np.arange(1.0, seconds - 1, 1 / 15)
    J = random.normal(size=(3, 40))
    at = np.stack([np.interp(images, times, q) for q in joints.T], axis=1)
    flows = np.diff(at, axis=0) @ J
    samples = MotionSamples(list(itertools.pairwise(images)), list(flows))
    log = JointLog(("a", "b", "c"), times * (1 + rate) + 0.02, joints)
    found = find_clock_offset(samples, log)
    assert found.drift == pytest.approx(-rate, rel=0.1)
    assert np.abs(found.applied(log).times - times).max() < 0.01
    steady = find_clock_offset(samples, JointLog(("a", "b", "c"), times + 0.02, joints))
    assert steady.drift == 0
    assert steady.seconds == pytest.approx(-0.02, abs=0.002)
