"""What of a machine decides how implementations compare on it: vectors, the rate of copies, how soon threads wake.

A ratio of times belongs to a machine: one that interprets is held up by the clock, one in planes by memory, one on all
cores by how soon a sleeping thread runs.
"""

from pathlib import Path

import numpy as np
import warp as wp
from roofline import copy_rate, median_seconds

from dense_vs.device import resolve_threads
from dense_vs.kernels.image.flow_field import count_bad_flow
from dense_vs.kernels.launch import PixelLaunch

COPIED = {"0.5 MB": 1 << 17, "8 MB": 1 << 21, "64 MB": 1 << 24}  # floats


def machine_facts() -> dict[str, float]:
    """Facts of this machine by name, with their units."""
    device = wp.get_device("cpu")
    facts = {"vector width [bits]": float(_vector_bits())}
    facts |= {f"copy of {name} [GB/s]": copy_rate(device, count) / 1e9 for name, count in COPIED.items()}
    vec2 = wp.vec2
    flow = wp.zeros((1, 64, 2), dtype=vec2, device=device)
    bad = wp.zeros((1, 64), dtype=wp.int32, device=device)
    for threads in sorted({1, resolve_threads()}):
        launch = PixelLaunch(count_bad_flow, flow.shape, [flow, bad], device, threads)
        facts[f"empty launch, {threads} threads [us]"] = 1e6 * median_seconds(launch, device, repeats=1000)
    return facts


def _vector_bits() -> int:
    """Width of the vectors that the processor has; 0 where the system does not say."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return 0
    flags = set(next((line for line in text.splitlines() if line.startswith("flags")), "").split())
    return next((bits for flag, bits in (("avx512f", 512), ("avx2", 256), ("sse2", 128)) if flag in flags), 0)


def spread(values: list[float]) -> list[float]:
    """Least, median and greatest."""
    return [float(value) for value in np.quantile(values, (0.0, 0.5, 1.0))]
