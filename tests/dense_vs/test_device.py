"""Which device, how many threads, and what is said where a GPU is missing or full."""

import threading

import numpy as np
import pytest
import warp as wp
from threadpoolctl import threadpool_info, threadpool_limits

from dense_vs import BatchFlow, DenseJacobian, DenseVSError
from dense_vs.device import _blas_libraries, one_blas_thread, resolve_device, room_for


@pytest.mark.parametrize("device", ["cuda:17", "gpu", "", "cpu:0"])
def test_a_device_that_is_not_there_is_answered_with_those_that_are(device):
    with pytest.raises(DenseVSError, match=r"is not present; expected 'auto' or one of .*cpu"):
        resolve_device(device)


def test_a_driver_that_is_too_old_is_named(monkeypatch):
    runtime = wp._src.context.runtime
    monkeypatch.setattr(runtime, "driver_version", (11, 0))
    monkeypatch.setattr(runtime, "min_driver_version", (12, 0))
    with pytest.raises(DenseVSError, match=r"driver is for CUDA 11\.0, Warp needs at least 12\.0"):
        resolve_device("cuda:17")


@pytest.mark.parametrize("device", [np.zeros(2), 10**5000, None, b"cpu", "x" * 9999, "cuda" * 9999], ids=type)
def test_what_names_no_device_is_refused_in_a_few_words(device):
    with pytest.raises(DenseVSError, match=r"^device .* is not present; expected 'auto' or one of .*cpu") as refused:
        resolve_device(device)
    assert len(str(refused.value)) < 600


class FullDevice:
    alias, is_cuda, free_memory = "cuda:0", True, 3 * 2**30


@pytest.fixture(autouse=True)
def without_a_gpu_nothing_is_to_be_forgotten(monkeypatch, request):
    if "gpu" not in request.keywords:
        monkeypatch.setattr("dense_vs.device._forget_failure", lambda device: None)


def test_a_full_gpu_says_how_many_worlds_fit():
    message = r"batch flow of 64 worlds needs about 8\.0 GiB; cuda:0 had 3\.0 GiB free, in which 24 worlds fit"
    with pytest.raises(DenseVSError, match=message), room_for("batch flow", 64, 2**27, FullDevice()):
        raise RuntimeError("Failed to allocate 123 bytes on device 'cuda:0'")


def test_other_failures_are_passed_on():
    with pytest.raises(RuntimeError, match="launch failed"), room_for("batch flow", 64, 2**27, FullDevice()):
        raise RuntimeError("launch failed")


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_real_gpu_that_is_full_says_so_and_goes_on():
    worlds = 60_000
    with pytest.raises(DenseVSError, match="worlds fit"):
        DenseJacobian(height=480, width=640, joints=4, worlds=worlds, order=1, device="cuda:0")
    with pytest.raises(DenseVSError, match="worlds fit"):
        BatchFlow(worlds, 480, 640, device="cuda:0")
    rows = wp.array(np.arange(12, dtype=np.float32).reshape(3, 4), device="cuda:0")
    column = wp.zeros((3, 1), dtype=float, device="cuda:0")
    wp.copy(column, rows[:, 1:2])  # of all launches this one reported the failed allocation as its own
    np.testing.assert_array_equal(column.numpy()[:, 0], [1, 5, 9])


def test_linear_algebra_keeps_to_one_thread_within_the_block_and_only_there():
    _blas_libraries()  # which loads SciPy's own, with the number of threads that the environment says

    def threads():
        return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        assert len(threads()) >= 2  # NumPy's and SciPy's own
        assert set(threads()) == {2}
        with one_blas_thread():
            assert set(threads()) == {1}
        assert set(threads()) == {2}


def test_a_block_within_another_asks_nothing_and_ends_nothing(monkeypatch):
    asked = []
    limit = type(_blas_libraries()).limit
    monkeypatch.setattr(type(_blas_libraries()), "limit", lambda *a, **given: asked.append(1) or limit(*a, **given))

    def numbers():
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        with one_blas_thread():
            with one_blas_thread():
                assert numbers() == {1}
            with pytest.raises(ValueError, match="within"), one_blas_thread():
                raise ValueError("within")
            assert numbers() == {1}
            thread = threading.Thread(target=one_blas_thread()(lambda: None))
            thread.start()
            thread.join(20)
            assert (numbers(), len(asked)) == ({1}, 2)  # another thread asks for itself
        assert numbers() == {2}
        with pytest.raises(ValueError, match="within"), one_blas_thread():
            raise ValueError("within")
        assert numbers() == {2}
        with one_blas_thread():
            assert (numbers(), len(asked)) == ({1}, 4)
