"""Runs of neighbouring pixels as one vector: what makes a pixel kernel use a CPU's wide registers.

Seen through :func:`runs`, element ``[..., x]`` of an image is the vector of the ``lanes`` pixels from x on: the
elements overlap, and any x may be read or written. A kernel computes a run at once and steps by ``lanes``; the
last run of a row is moved left until it fits, so that its first pixels are computed twice, to the same
value. On a GPU the same kernel is one of a thread a pixel or two.
"""

from typing import Any

import warp as wp

CPU_LANES = 16
GPU_LANES = 2  # less to compute per pixel for where it lies
# Warp's own flags cut short the compiler's search for vector instructions: half the speed. A fused
# multiply-add needs asking for.
CPU_FLAGS = "-march=native -ffp-contract=fast"
CPU_FLAGS_SHALLOW = f"{wp.config.cpu_compiler_flags or '-march=native'} -ffp-contract=fast"
_SIZES = {wp.float32: 4, wp.uint8: 1}


def lanes_on(device: Any) -> int:
    """Pixels that a kernel computes at once on a device; a row must have at least as many."""
    return CPU_LANES if wp.get_device(device).is_cpu else GPU_LANES


def run_module(name: str, cpu_flags: str = CPU_FLAGS) -> Any:
    """Warp module for kernels over runs."""
    module = wp.get_module(name)
    wp.set_module_options({"cpu_compiler_flags": cpu_flags}, module)
    return module


def run_type(lanes: int, dtype: Any = wp.float32) -> Any:
    """Vector of ``lanes`` pixels."""
    return wp.types.vector(lanes, dtype)


def runs(image: wp.array, lanes: int) -> wp.array:
    """View of the rows, the last axis, as overlapping runs: shape ``(..., width - lanes + 1)``."""
    if image.strides[-1] != _SIZES[image.dtype]:
        raise ValueError(f"rows with a stride of {image.strides[-1]} bytes cannot be seen as runs of {image.dtype}")
    *leading, width = image.shape
    view = wp.array(
        ptr=image.ptr,
        dtype=run_type(lanes, image.dtype),
        shape=(*leading, width - lanes + 1),
        strides=image.strides,
        device=image.device,
    )
    view._source = image  # the view does not own the memory
    return view


def run_count(width: int, lanes: int) -> int:
    """Runs that cover a row."""
    return -(-width // lanes)


@wp.func
def run_begin(run: int, lanes: int, width: int) -> int:
    """First pixel of a run."""
    return wp.min(run * lanes, width - lanes)
