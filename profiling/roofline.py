"""Predict and update against the rate at which the device copies memory.

    python profiling/roofline.py [--device cpu] [--worlds 1] [--size 320x240] [--joints 4] [--json FILE]

The bytes are those that one pass has to move: state and per-pixel covariance read and written once, the flow read
once. The share is their time at the measured copy rate by the time that a frame takes.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from filter_case import make_case
from metrics import Metric, add_report_arguments, report

from dense_vs.device import resolve_device
from dense_vs.jacobian.estimator import DenseJacobian

FORMS: dict[str, dict[str, Any]] = {
    "diagonal": {"covariance": "diagonal", "prediction_iterations": 1},
    "shared, order 1": {"order": 1},
    "shared, order 2": {"order": 2},
    "batch, order 1": {"order": 1, "prediction": "model"},
    "batch, order 2": {"order": 2, "prediction": "model"},
}
FLOAT = 4  # bytes


def median_seconds(call: Callable[[], Any], device: wp.Device, repeats: int = 30) -> float:
    """Median time of a call, until the device has finished it."""
    for _ in range(3):
        call()
    seconds = np.empty(repeats)
    for k in range(repeats):
        wp.synchronize_device(device)
        start = time.perf_counter()
        call()
        wp.synchronize_device(device)
        seconds[k] = time.perf_counter() - start
    return float(np.median(seconds))


def copy_rate(device: wp.Device, count: int) -> float:
    """Bytes read and written per second by a copy of ``count`` floats."""
    source = wp.zeros(count, dtype=wp.float32, device=device)
    target = wp.empty_like(source)
    return 2 * FLOAT * count / median_seconds(lambda: wp.copy(target, source), device)


def one_pass_bytes(estimator: DenseJacobian) -> int:
    """Bytes that a frame has to move."""
    options, columns = estimator.options, estimator.filter.kernels.columns
    floats = 2 * (2 * columns) + 2
    if options.covariance == "diagonal":
        floats += 2 * options.joints
    return FLOAT * floats * options.worlds * options.height * options.width


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Predict and update against the device's copy rate.")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    parser.add_argument("--worlds", default="1", help="numbers of worlds, by comma (default: 1)")
    parser.add_argument("--size", default="320x240", help="image size (default: 320x240)")
    parser.add_argument("--joints", type=int, default=4, help="number of joints (default: 4)")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    width, height = (int(side) for side in arguments.size.split("x"))
    device = resolve_device(arguments.device)
    case = make_case(height, width, arguments.joints, frames=1)
    metrics = []
    for worlds in (int(number) for number in arguments.worlds.split(",")):
        for name, options in FORMS.items():
            estimator = DenseJacobian(
                height=height,
                width=width,
                joints=arguments.joints,
                worlds=worlds,
                device=device.alias,
                on_bad_flow="skip",
                **options,
            )
            arrays = estimator.filter
            arrays.flow.assign(np.broadcast_to(case.flow, (worlds, height, width, 2)))
            steps = np.broadcast_to(case.dq, (worlds, arguments.joints)).copy()
            seconds = median_seconds(lambda arrays=arrays, steps=steps: arrays.advance(steps), device)
            moved = one_pass_bytes(estimator)
            del estimator, arrays
            # A copy of as many bytes, so that both meet the same level of the cache.
            rate = copy_rate(device, moved // (2 * FLOAT))
            label = f"{name}, {worlds} worlds, {device.alias}"
            metrics += [
                Metric(f"predict_update_ms, {label}", 1e3 * seconds, "ms", "lower", 0.2),
                Metric(f"frames_per_second, {label}", worlds / seconds, "fps", "higher", 0.2),
                Metric(f"share_of_copy_rate, {label}", moved / seconds / rate, "1", "higher", 0.2),
                Metric(f"copy_rate, {label}", rate / 1e9, "GB/s", "higher", 0.2),
            ]
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
