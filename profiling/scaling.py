"""How predict and update scale: with joints, image size, worlds and CPU threads.

    python profiling/scaling.py [--device cpu] [--json FILE]

One thing varies at a time, from 320x240 with 4 joints in one world in the filter of order 1. The ratio beside each
time is to the first of its row: of nanoseconds per pixel and world, so that 1 is proportional cost.
"""

import argparse
import os

import numpy as np
import warp as wp
from filter_case import make_case
from metrics import Metric, add_report_arguments, report
from roofline import median_seconds

from dense_vs.device import resolve_device
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.kernels.launch import available_cores

JOINTS = (1, 2, 4, 7, 10, 16, 32)
SIZES = ((160, 120), (320, 240), (640, 480), (1280, 720))
WORLDS = {"cpu": (1, 2, 4, 8), "cuda": (1, 4, 16, 64, 256, 1024, 4096)}


def update_seconds(device: wp.Device, *, size=(320, 240), joints=4, worlds=1, threads=None) -> float:
    """Median time of one frame's predict and update."""
    width, height = size
    case = make_case(height, width, joints, frames=1)
    estimator = DenseJacobian(
        height=height,
        width=width,
        joints=joints,
        worlds=worlds,
        device=device.alias,
        threads=threads,
        order=1,
        on_bad_flow="skip",
    )
    arrays = estimator.filter
    arrays.flow.assign(np.broadcast_to(case.flow, (worlds, height, width, 2)))
    steps = np.broadcast_to(case.dq, (worlds, joints)).copy()
    return median_seconds(lambda: arrays.advance(steps), device)


def rows_of(device: wp.Device) -> list[tuple[str, str, dict]]:
    """(row, value, arguments) of all measurements."""
    rows = [("joints", str(n), {"joints": n}) for n in JOINTS]
    rows += [("size", f"{w}x{h}", {"size": (w, h)}) for w, h in SIZES]
    rows += [("worlds", str(b), {"worlds": b}) for b in WORLDS["cpu" if device.is_cpu else "cuda"]]
    if device.is_cpu:
        cores = available_cores()
        counts = sorted({1, 2, cores} | {n for n in (4, 8, 16, 32) if n <= (os.cpu_count() or 1)})
        rows += [("threads", str(n), {"threads": n}) for n in counts if n <= cores]
    return rows


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="How predict and update scale.")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    device = resolve_device(arguments.device)
    metrics: list[Metric] = []
    first: dict[str, float] = {}
    for row, value, options in rows_of(device):
        width, height = options.get("size", (320, 240))
        pixels = width * height * options.get("worlds", 1)
        try:
            seconds = update_seconds(device, **options)
        except DenseVSError as error:
            print(f"{row} {value}: {error}")
            continue
        per_pixel = seconds / pixels
        ratio = per_pixel / first.setdefault(row, per_pixel)
        label = f"{row} {value}, {device.alias}"
        print(f"{label}: {1e3 * seconds:.3f} ms, {1e9 * per_pixel:.3f} ns a pixel", flush=True)
        metrics.append(Metric(f"predict and update, {label}", 1e3 * seconds, "ms", "lower", 0.2))
        metrics.append(Metric(f"cost per pixel to the first, {label}", ratio, "x", "lower", 0.25))
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
