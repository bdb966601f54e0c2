"""Which device the kernels run on and how many CPU threads they use."""

import functools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

import warp as wp
from threadpoolctl import ThreadpoolController

from dense_vs.checks import check_whole, shown
from dense_vs.errors import DenseVSError
from dense_vs.kernels.launch import available_cores
from dense_vs.memory import free_memory

GIBIBYTE = 2**30
MOST_THREADS = 1024  # each is a thread of the system, kept for the life of the process


def resolve_device(device: str = "auto") -> wp.Device:
    """Warp device for ``"auto"`` (the first GPU, else the CPU), ``"cpu"``, ``"cuda"`` or ``"cuda:N"``.

    Raises:
        DenseVSError: no such device; the message lists those present.
    """
    wp.init()
    if isinstance(device, wp.Device):
        return device
    present = [d.alias for d in wp.get_devices()]
    if isinstance(device, str) and device == "auto":
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    name = "cuda:0" if isinstance(device, str) and device == "cuda" else device
    if not isinstance(name, str) or name not in present:
        raise DenseVSError(
            f"device {shown(device)} is not present; expected 'auto' or one of {', '.join(present)}"
            f"{_driver_remark(name)}"
        )
    return wp.get_device(name)


@contextmanager
def room_for(what: str, worlds: int, bytes_per_world: int, device: wp.Device) -> Iterator[None]:
    """Turn the device's failure to allocate into an error that says how many worlds would fit.

    A CPU's memory is asked for beforehand: Linux promises more than there is and ends the process when it is used.

    Args:
        what: is allocated in the block.
        worlds: number of them.
        bytes_per_world: that one of them takes, about.
        device: Warp device.

    Raises:
        DenseVSError: the device's memory does not suffice.
    """
    free = device.free_memory if device.is_cuda else free_memory()
    needed = worlds * bytes_per_world
    message = (
        f"{what} of {worlds} worlds needs about {needed / GIBIBYTE:.1f} GiB; {device.alias} had "
        f"{free / GIBIBYTE:.1f} GiB free, in which {free // max(bytes_per_world, 1)} worlds fit"
    )
    if not device.is_cuda and needed > free:
        raise DenseVSError(message)
    try:
        yield
    except MemoryError as error:
        raise DenseVSError(message) from error
    except RuntimeError as error:
        if "allocate" not in str(error):
            raise
        if device.is_cuda:
            _forget_failure(device)
        raise DenseVSError(message) from error


class NotCopied:
    """Refuses ``copy`` and ``pickle`` in words: memory of a device, a thread or another library cannot go along."""

    def __reduce_ex__(self, _: Any) -> NoReturn:
        what = "save() and load()" if hasattr(self, "save") else "one made anew"
        raise DenseVSError(f"a {type(self).__name__} cannot be copied or pickled; expected {what}")


def _forget_failure(device: wp.Device) -> None:
    """Let the driver's note of a failed allocation go; else the next copy of rows reports it as its own."""
    rows: Any = wp.zeros((2, 2), dtype=wp.float32, device=device)
    with suppress(RuntimeError):
        wp.copy(wp.zeros((2, 1), dtype=wp.float32, device=device), rows[:, :1])


def _driver_remark(name: Any) -> str:
    """Why a GPU is not there, where Warp knows."""
    runtime: Any = wp._src.context.runtime
    found, needed = runtime.driver_version, runtime.min_driver_version
    if not isinstance(name, str) or not name.startswith("cuda") or found is None or needed is None or found >= needed:
        return ""
    return f"; the NVIDIA driver is for CUDA {found[0]}.{found[1]}, Warp needs at least {needed[0]}.{needed[1]}"


def resolve_threads(threads: int | None = None) -> int:
    """CPU threads for one launch: the argument, else ``DENSE_VS_THREADS``, else all allowed cores.

    More threads than cores is allowed and gives the same bits, only no faster.

    Raises:
        DenseVSError: not a whole number from 1 to 1024.
    """
    if threads is not None:
        return check_whole("threads", threads, least=1, most=MOST_THREADS)
    text = os.environ.get("DENSE_VS_THREADS", "").strip()
    if not text:
        return available_cores()
    # Longer digits are no number of threads, and no int that is made quickly.
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    if not 1 <= number <= MOST_THREADS:
        raise DenseVSError(
            f"DENSE_VS_THREADS is {text!r}; expected a whole number of at least 1 and at most {MOST_THREADS}"
        )
    return number


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keeps linear algebra of NumPy and SciPy to one thread within a block or a function.

    The matrices here are small. Threads of OpenBLAS wait for one another by spinning: beside other programs that use
    all cores, a fit of seconds took minutes. Within another such block nothing is asked of the libraries, which takes
    as long as some of what is kept to one thread.
    """
    if _BLAS_LIMIT.here:
        yield
        return
    with _blas_libraries().limit(limits=1, user_api="blas"):
        _BLAS_LIMIT.here = True
        try:
            yield
        finally:
            _BLAS_LIMIT.here = False


class _BlasLimit(threading.local):
    """Whether a thread is within a block that asks for one thread; the libraries know whose word counts."""

    here = False


_BLAS_LIMIT = _BlasLimit()


@functools.cache
def _blas_libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 - so that its library is found too

    return ThreadpoolController()
