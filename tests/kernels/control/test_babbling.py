"""Babbling of many worlds: its process in float64, Babbling's statistics, and its pace from the flow."""

import numpy as np
import pytest
import warp as wp

from dense_vs import Babbling
from dense_vs.kernels.control.babbling import BabblingState, babbling_steps, restart_babbling, watch_flow
from dense_vs.kernels.control.servo_law import limits_array

OPTIONS = {"amplitude": 0.15, "time_constant": 0.4, "frame_time": 1 / 30}


class Batch:
    """A state, and what its steps need; positions stay where they are set."""

    def __init__(self, worlds, joints, limits=None, where=None, device="cpu"):
        self.device = device
        self.state = BabblingState.empty(np.arange(worlds) + 3, joints, device)
        self.positions = wp.zeros((worlds, joints), dtype=float, device=device)
        self.limits = limits_array(limits, joints, device)
        self.where = wp.array(np.ones(worlds) if where is None else where, dtype=int, device=device)
        self.steps = wp.full((worlds, joints), float("nan"), dtype=float, device=device)

    def watch(self, flow, max_flow=4.0):
        watch_flow(self.state, wp.array(flow, dtype=wp.vec2, device=self.device), max_flow=max_flow)

    def launch(self, **options):
        babbling_steps(self.state, self.positions, self.limits, self.where, self.steps, **{**OPTIONS, **options})

    def __call__(self, **options):
        self.launch(**options)
        return self.steps.numpy().copy()


@pytest.mark.parametrize("joints", [1, 4, 7])
def test_excites_every_dimension_as_babbling_does(joints):
    batch = Batch(60, joints)
    steps = np.array([batch() for _ in range(300)])  # 10 s at 30 fps
    excitation = np.array([np.linalg.svd(steps[:, k])[1].min() ** 2 for k in range(60)])
    moments = np.linalg.eigvalsh(batch.state.moments.numpy().astype(float))[:, 0]
    np.testing.assert_allclose(moments, excitation, rtol=1e-3)
    reference = []
    for seed in range(60):
        one = Babbling(joints, seed=seed)
        for _ in range(300):
            one.step()
        reference.append(one.excitation)
    assert np.median(excitation) == pytest.approx(np.median(reference), rel=0.25)
    assert np.sqrt(0.01 / excitation.min()) < 3  # px/rad, what J is known to with r = 0.01 px^2


@pytest.mark.parametrize("joints", [2, 4, 7])
def test_kicks_harder_what_has_moved_less(joints):
    """As strong as one of the same random numbers in a world that has not moved, and turned as the moments ask."""
    rng = np.random.default_rng(joints)
    roots = rng.normal(size=(20, joints, joints)) * np.geomspace(1, 30, joints)
    moments = (roots @ roots.transpose(0, 2, 1)).astype(np.float32)
    even, uneven = Batch(20, joints), Batch(20, joints)
    uneven.state.moments.assign(moments)
    even(), uneven()
    for kick, turned, m in zip(even.state.kick.numpy(), uneven.state.kick.numpy(), moments, strict=True):
        values, vectors = np.linalg.eigh(m.astype(float))
        expected = vectors @ ((1 - values / (2 * values.sum())) ** (2 * joints) * (vectors.T @ kick))
        np.testing.assert_allclose(
            turned, expected * np.linalg.norm(kick) / np.linalg.norm(expected), atol=1e-5, rtol=1e-4
        )


def test_statistics():
    """Excursions of the asked standard deviation, within three of it; one world's joints and two worlds apart."""
    batch = Batch(64, 3)
    path = np.cumsum([batch(amplitude=0.1) for _ in range(1500)], axis=0)
    assert np.abs(path).max() <= 0.3 * (1 + 1e-5)
    np.testing.assert_allclose(path[200:].std(axis=(0, 1)), 0.1, rtol=0.08)
    np.testing.assert_allclose(path[-1], batch.state.offset.numpy(), atol=1e-5)
    reference = Babbling(192, amplitude=0.1, seed=1)
    step_size = np.std([reference.step() for _ in range(1500)])
    assert np.diff(path, axis=0).std() == pytest.approx(step_size, rel=0.03)
    last = path[200::50].reshape(-1, 64, 3)
    assert abs(np.mean(last[..., 0] * last[..., 1])) < 0.1 * 0.01
    assert abs(np.mean(last[:, :-1] * last[:, 1:])) < 0.1 * 0.01


def test_process_as_its_equation():
    batch = Batch(5, 2)
    offset = np.zeros((5, 2))
    for _ in range(20):
        step = batch()
        dt = 0.5 / 30 / 0.4
        goal = np.sqrt(2) * 0.15 * batch.state.noise.numpy()
        moved = np.clip(offset + dt * (goal - offset), -0.45, 0.45)
        np.testing.assert_allclose(step, moved - offset, atol=1e-6)
        offset = moved


def noisy_flow(rng, worlds, height, width):
    scale = rng.uniform(0.2, 4, (worlds, 1, 1, 1))
    flow = (rng.normal(0, 1, (worlds, height, width, 2)) * scale).astype(np.float32)
    flow[rng.uniform(size=flow.shape[:3]) < 0.1] = np.nan
    return flow


@pytest.mark.parametrize("seed", range(4))
def test_pace_follows_the_percentile(seed):
    """Within half a bin of the sorted sample, on images too small for the percentile to be smooth."""
    flow = noisy_flow(np.random.default_rng(seed), 60, 50, 61)
    batch = Batch(60, 2)
    batch.watch(flow)
    batch()
    for rate, u in zip(batch.state.rate.numpy(), flow, strict=True):
        speed = np.abs(u[::4, ::4]).max(axis=2)
        fastest = np.percentile(speed[np.isfinite(speed)], 99, method="higher")
        if fastest <= 4.0:
            assert rate == pytest.approx(0.525)
        else:
            assert rate == pytest.approx(0.5 * max(4.0 / fastest, 0.5), rel=0.0079)


def test_pace_as_babbling():
    rng = np.random.default_rng(0)
    batch = Batch(20, 2)
    reference = [Babbling(2, seed=k) for k in range(20)]
    for _ in range(4):
        flow = noisy_flow(rng, 20, 240, 320)
        batch.watch(flow)
        batch()
        for one, u in zip(reference, flow, strict=True):
            one.step(u)
    np.testing.assert_allclose(batch.state.rate.numpy(), [one.rate for one in reference], rtol=0.03)


def test_pace_without_flow_or_without_numbers():
    batch = Batch(2, 2)
    batch()
    np.testing.assert_array_equal(batch.state.rate.numpy(), 0.5)  # nothing was watched
    flow = np.full((2, 16, 16, 2), np.nan, np.float32)
    flow[1] = 100.0
    batch.watch(flow)
    batch()
    np.testing.assert_allclose(batch.state.rate.numpy(), [0.525, 0.25])
    for _ in range(20):
        batch.watch(flow)
        batch()
    np.testing.assert_allclose(batch.state.rate.numpy(), [min(0.5 * 1.05**21, 1), 0.02], rtol=1e-5)
    np.testing.assert_array_equal(batch.state.counts.numpy(), 0)


def test_slows_down_where_the_image_moves_too_fast():
    """Each step moves a world's image by 50 to 400 px/rad; the flow it is shown follows from its own steps."""
    stiffness = np.geomspace(50, 400, 8)
    batch = Batch(8, 3)
    flow, fastest = np.zeros((8, 16, 16, 2), np.float32), []
    for _ in range(500):
        batch.watch(flow, max_flow=2.0)
        flow[...] = (stiffness * np.abs(batch(amplitude=0.3)).sum(axis=1))[:, None, None, None]
        fastest.append(flow.max(axis=(1, 2, 3)))
    fastest = np.array(fastest[100:])
    assert (np.quantile(fastest, 0.9, axis=0) < 2 * 2.0).all()
    assert (np.median(fastest, axis=0) > 0.3).all()


def test_limits_hold_and_a_joint_outside_comes_back():
    limits = np.array([[-0.1, 0.1], [-np.inf, np.inf], [-0.05, 0.2]])
    batch = Batch(10, 3, limits)
    q = np.zeros((10, 3))
    q[:, 0] = 0.2
    for _ in range(300):
        batch.positions.assign(q)
        q = (batch.positions.numpy() + batch()).astype(np.float32)
        assert (q >= limits[:, 0] - 1e-6).all()
        assert (q <= limits[:, 1] + 1e-6).all()
    assert np.abs(q[:, 1]).max() > 0


def test_chosen_worlds_step_and_restart():
    where = np.array([1, 0, 1])
    batch = Batch(3, 2, where=where)
    for _ in range(5):
        steps = batch()
    np.testing.assert_array_equal(np.isnan(steps).all(axis=1), where == 0)
    np.testing.assert_array_equal(batch.state.draws.numpy(), [5, 0, 5])
    kept = batch.state.offset.numpy()[2].copy()
    restart_babbling(batch.state, wp.array([1, 0, 0], dtype=int, device="cpu"))
    for array in (batch.state.noise, batch.state.offset, batch.state.moments):
        np.testing.assert_array_equal(array.numpy()[0], 0)
    np.testing.assert_array_equal(batch.state.offset.numpy()[2], kept)
    np.testing.assert_array_equal(batch.state.draws.numpy(), [5, 0, 5])  # no random number comes twice


def test_seed_decides():
    one, same = (np.array([b() for _ in range(5)]) for b in (Batch(3, 2), Batch(3, 2)))
    np.testing.assert_array_equal(one, same)
    assert len(np.unique(one[-1].round(9))) == 6


@pytest.mark.gpu
def test_the_same_on_a_gpu_in_a_graph():
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    rng = np.random.default_rng(0)
    flow = rng.normal(0, 3, (20, 40, 60, 2)).astype(np.float32)
    on_cpu, on_gpu = Batch(20, 4), Batch(20, 4, device="cuda:0")
    shown = wp.array(flow, dtype=wp.vec2, device="cuda:0")
    on_gpu.launch()
    on_cpu()
    watch_flow(on_gpu.state, shown, max_flow=4.0)
    on_gpu.launch()
    with wp.ScopedCapture("cuda:0") as capture:
        watch_flow(on_gpu.state, shown, max_flow=4.0)
        on_gpu.launch()
    for k in range(4):
        if k > 0:
            wp.capture_launch(capture.graph)
        on_cpu.watch(flow)
        np.testing.assert_allclose(on_gpu.steps.numpy(), on_cpu(), atol=1e-6)
    np.testing.assert_allclose(on_gpu.state.rate.numpy(), on_cpu.state.rate.numpy(), rtol=1e-5)
