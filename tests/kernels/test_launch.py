"""Row bands on many threads: every pixel written once, and the same bits for any number of threads."""

import numpy as np
import pytest
import warp as wp

from dense_vs import DenseJacobian, DenseVSError
from dense_vs.device import resolve_threads
from dense_vs.kernels.image.flow_field import count_bad_flow
from dense_vs.kernels.jacobian.image_jacobian import jacobian_kernels
from dense_vs.kernels.launch import PixelLaunch, available_cores, launch_pixels


@pytest.mark.parametrize("height", [1, 2, 3, 10, 23])
@pytest.mark.parametrize("threads", [1, 2, 3, 7, 64])
def test_bands_cover_every_pixel_of_every_world(height, threads):
    rng = np.random.default_rng(height)
    shape = (2, height, 5)
    kernels = jacobian_kernels(4, 1)
    state = rng.integers(-9, 9, (*shape, 2, 4)).astype(np.float32)
    dq = rng.integers(-9, 9, (2, 4)).astype(np.float32)  # whole numbers: float32 is exact
    out = wp.full(shape, wp.vec2(np.nan, np.nan), dtype=wp.vec2, device="cpu")
    inputs = [wp.array(state, dtype=kernels.State, device="cpu"), wp.array(dq, dtype=kernels.StateRow, device="cpu")]
    launch_pixels(kernels.predicted_flow, shape, [*inputs, out], "cpu", threads)
    np.testing.assert_array_equal(out.numpy(), np.einsum("bhwcn,bn->bhwc", state, dq))


@pytest.mark.parametrize("threads", [1, 3])
def test_recorded_launch_reads_the_present_content(threads):
    flow = wp.zeros((2, 6, 4), dtype=wp.vec2, device="cpu")
    bad = wp.zeros((2, 6), dtype=int, device="cpu")
    launch = PixelLaunch(count_bad_flow, (2, 6, 4), [flow, bad], "cpu", threads)
    launch()
    assert bad.numpy().sum() == 0
    flow.numpy()[1, 4, :3, 1] = np.nan, np.inf, -np.inf
    launch()
    expected = np.zeros((2, 6), int)
    expected[1, 4] = 3
    np.testing.assert_array_equal(bad.numpy(), expected)


def run(form, order, threads):
    rng = np.random.default_rng(0)
    estimator = DenseJacobian(
        height=23, width=17, joints=4, worlds=2, covariance=form, order=order, threads=threads, device="cpu"
    )
    for _ in range(3):
        estimator.update(rng.normal(0, 2, (2, 23, 17, 2)).astype(np.float32), rng.normal(0, 0.03, (2, 4)))
    return [np.array(a) for a in (estimator.jacobian, estimator.variance, estimator.predicted_flow(np.ones((2, 4))))]


FORMS = [("shared", 2), ("shared", 1), ("diagonal", 1), ("fixed", 1), ("full", 1)]


@pytest.mark.parametrize(("form", "order"), FORMS)
def test_any_number_of_threads_gives_the_same_bits(form, order, monkeypatch):
    alone = run(form, order, threads=1)
    for threads in (2, 3, 7):
        for one, many in zip(alone, run(form, order, threads), strict=True):
            np.testing.assert_array_equal(one, many)
    monkeypatch.setenv("DENSE_VS_THREADS", "5")
    for one, many in zip(alone, run(form, order, threads=None), strict=True):
        np.testing.assert_array_equal(one, many)


def test_threads_come_from_the_argument_then_the_environment_then_the_cores(monkeypatch):
    monkeypatch.setenv("DENSE_VS_THREADS", " 5 ")
    assert resolve_threads(3) == 3
    assert resolve_threads() == 5
    for unset in ("", "  "):
        monkeypatch.setenv("DENSE_VS_THREADS", unset)
        assert resolve_threads() == available_cores()
    monkeypatch.delenv("DENSE_VS_THREADS")
    assert resolve_threads() == available_cores() >= 1


@pytest.mark.parametrize("threads", [0, -1, "many", 1.5, float("inf"), float("nan"), [2]])
def test_refuses_a_thread_count(threads):
    with pytest.raises(DenseVSError, match=r"threads is .*expected a whole number of at least 1"):
        DenseJacobian(height=8, width=8, joints=4, threads=threads)


@pytest.mark.parametrize("text", ["0", "-2", "all", "2.5"])
def test_refuses_a_thread_count_in_the_environment(text, monkeypatch):
    monkeypatch.setenv("DENSE_VS_THREADS", text)
    with pytest.raises(DenseVSError, match=rf"DENSE_VS_THREADS is '{text}'; expected a whole number of at least 1"):
        DenseJacobian(height=8, width=8, joints=4)
