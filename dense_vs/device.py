"""Which device the kernels run on and how many CPU threads they use."""

import os
from typing import Any

import warp as wp

from dense_vs.errors import DenseVSError
from dense_vs.kernels.launch import available_cores


def resolve_device(device: str = "auto") -> wp.Device:
    """Warp device for ``"auto"`` (the first GPU, else the CPU), ``"cpu"``, ``"cuda"`` or ``"cuda:N"``.

    Raises:
        DenseVSError: no such device; the message lists those present.
    """
    wp.init()
    if isinstance(device, wp.Device):
        return device
    present = [d.alias for d in wp.get_devices()]
    if device == "auto":
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    name = "cuda:0" if device == "cuda" else device
    if name not in present:
        raise DenseVSError(f"device {device!r} is not present; expected 'auto' or one of {', '.join(present)}")
    return wp.get_device(name)


def resolve_threads(threads: int | None = None) -> int:
    """CPU threads for one launch: the argument, else ``DENSE_VS_THREADS``, else all allowed cores.

    More threads than cores is allowed and gives the same bits, only no faster.

    Raises:
        DenseVSError: not a whole number of at least 1.
    """
    source = "threads"
    value: Any = threads
    if threads is None:
        text = os.environ.get("DENSE_VS_THREADS", "").strip()
        if not text:
            return available_cores()
        source, value = "DENSE_VS_THREADS", text
    try:
        count = int(value)
    except (TypeError, ValueError, OverflowError):
        count = 0
    if count < 1 or (isinstance(value, float) and value != count):
        raise DenseVSError(f"{source} is {value!r}; expected a whole number of at least 1")
    return count
