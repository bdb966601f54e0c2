"""Batch flow in passes and in tiles: time, what takes it, memory, and how far the two are apart.

    python profiling/batch_flow.py [--worlds 1024] [--device cuda] [--json FILE]

Stages are timed by themselves, as CUDA graphs on a GPU. The bytes that a frame has to move are the image, each
expansion written once and read as its own and as the other image's, and the displacements; the share is their time at
the measured copy rate by the time that a frame takes.
"""

import argparse
from collections.abc import Callable

import cv2
import numpy as np
import warp as wp
from closed_loop import captured, seconds_per_call
from metrics import Metric, add_report_arguments, report
from roofline import copy_rate

from dense_vs.device import resolve_device
from dense_vs.flow.batch_flow import BATCH_METHODS, GUIDED_METHODS
from dense_vs.kernels.flow.farneback import Farneback

METHODS = BATCH_METHODS | GUIDED_METHODS
DIFFERENT = 8  # images that differ; the other worlds repeat them


def images(worlds: int, height: int, width: int) -> list[np.ndarray]:
    """Two images of each world: noise at three scales, turned and shifted by up to about 5 px."""
    rng = np.random.default_rng(0)
    pairs = []
    for number in range(DIFFERENT):
        noise = sum(cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), s) * s for s in (1.2, 3, 8))
        first = np.clip(128 + 45 * (noise - noise.mean()) / noise.std(), 0, 255).astype(np.uint8)
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), 0.2 * number, 1.0)
        turn[:, 2] += rng.uniform(-2, 2, 2)
        second = cv2.warpAffine(first, turn, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        pairs.append((first, second))
    return [np.stack([pairs[world % DIFFERENT][k] for world in range(worlds)]) for k in range(2)]


def least_bytes(method: Farneback) -> int:
    """Bytes that a frame has to move in the device's memory."""
    worlds, height, width = method.image.shape
    scales = method.options.scales(height, width)
    of_a_level = 16 + 2 * 16 + 8  # expansion written, both read, displacement written
    pixels = [round(height * scale) * round(width * scale) for scale in scales]
    finest, *coarser = pixels
    return worlds * (len(scales) * finest + of_a_level * (finest + sum(coarser)) + 8 * sum(coarser))


def one_after_another(launches: list[Callable[[], None]]) -> Callable[[], None]:
    """All of them as one call."""

    def call() -> None:
        for launch in launches:
            launch()

    return call


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Batch flow in passes and in tiles.")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    parser.add_argument("--worlds", type=int, default=1024, help="worlds (default: 1024)")
    parser.add_argument("--size", default="320x240", help="image size (default: 320x240)")
    parser.add_argument("--flow", default="farneback-warp", choices=METHODS, help="method of BatchFlow")
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    width, height = (int(side) for side in arguments.size.split("x"))
    device, worlds = resolve_device(arguments.device), arguments.worlds
    pair = images(worlds, height, width)
    metrics, flows = [], []
    rate = copy_rate(device, min(worlds * 2**18, 2**30))
    for form in ("passes", "tiles"):
        label = f"{worlds} worlds, {device.alias}"
        free = device.free_memory if device.is_cuda else 0
        method = Farneback(worlds, height, width, METHODS[arguments.flow], device=device, tiles=form == "tiles")
        used = (free - device.free_memory) / 2**30 if device.is_cuda else float("nan")
        for image in pair:
            method.image.assign(image)
            method.push()
        method.calculate()
        flows.append(method.flow.numpy()[:DIFFERENT].copy())

        def frame(method: Farneback = method) -> None:
            method.push()
            method.calculate()

        seconds = seconds_per_call(captured(frame, device), device)
        parts = {"expansions": method._expand, "displacements": method._solve}
        for name, launches in parts.items():
            alone = seconds_per_call(captured(one_after_another(launches), device), device, 0.2)
            metrics.append(Metric(f"{name} in {form}, {label}", 1e3 * alone, "ms", "lower", 0.1))
        if form == "tiles":
            for number, launch in enumerate([*method._expand, *method._solve]):
                alone = seconds_per_call(captured(launch, device), device, 0.1)
                metrics.append(Metric(f"launch {number} in tiles, {label}", 1e3 * alone, "ms", "lower", 0.1))
        share = least_bytes(method) / seconds / rate
        metrics += [
            Metric(f"flow in {form}, {label}", 1e3 * seconds, "ms", "lower", 0.1),
            Metric(f"share of the copy rate, flow in {form}, {label}", share, "1", "higher", 0.1),
            Metric(f"memory, flow in {form}, {label}", used, "GiB", "lower", 0.02),
        ]
        del method, frame, parts, launches
    apart = np.linalg.norm(flows[1] - flows[0], axis=-1)
    metrics += [
        Metric("tiles from passes, mean", float(apart.mean()), "px", "lower"),
        Metric("tiles from passes, 99.9th percentile", float(np.quantile(apart, 0.999)), "px", "lower"),
        Metric(f"copy rate, {device.alias}", rate / 1e9, "GB/s", "higher", 0.2),
    ]
    return report(metrics, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
