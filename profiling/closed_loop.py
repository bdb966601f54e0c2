"""The whole servo loop of many simulated robots: frames a second, where the time goes, memory, and whether it closes.

    python profiling/closed_loop.py [--worlds 1024] [--device cuda] [--targets 1] [--randomize] [--json FILE]
    python profiling/closed_loop.py --worlds 2048 --gpus 1,2                # a process a GPU
    python profiling/closed_loop.py --gate profiling/results/closed_loop_h200.json --randomize

Speed is that of whole frames in the babbling phase, a stage's that of the stage alone repeated; both as CUDA graphs on
a GPU. Then every world babbles, reaches its targets and is measured against the simulator's truth. The gate fails on a
loss of more than a tenth against an earlier result of the same kind of machine.
"""

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from metrics import Metric, add_report_arguments, report
from speed_gate import beside, hold_to

from dense_vs.checks import check_whole
from dense_vs.device import resolve_device
from dense_vs.errors import DenseVSError
from dense_vs.jacobian.filter import JacobianFilter
from dense_vs.point_servo import ReachEnd
from dense_vs.sims import BatchServo, DomainRandomization
from dense_vs.sims.batch.case import RANDOMIZED, BatchCase
from dense_vs.sims.batch.episode import EpisodeOptions
from dense_vs.sims.batch.rank import Rank, run_ranks
from dense_vs.view.provenance import provenance
from dense_vs.view.tables import table

WITHIN_PX = 3.0
MEASURED_SECONDS = 3.0  # by each of several processes at once
LONGEST_START = 500.0  # s, of the slowest process


def seconds_per_call(call: Callable[[], Any], device: wp.Device, least_seconds: float = 0.5) -> float:
    """Mean time of a call, over at least that long and three rounds; the median round."""
    call()
    rounds, calls = [], 1
    while len(rounds) < 3 or sum(rounds) < least_seconds:
        wp.synchronize_device(device)
        start = time.perf_counter()
        for _ in range(calls):
            call()
        wp.synchronize_device(device)
        rounds.append(time.perf_counter() - start)
        if rounds[-1] < least_seconds / 10 and len(rounds) == 1:
            calls = max(1, int(least_seconds / 5 / rounds.pop()))
    return float(np.median(rounds)) / calls


def captured(call: Callable[[], Any], device: wp.Device) -> Callable[[], Any]:
    """The call as a CUDA graph; itself on a CPU."""
    if device.is_cpu:
        return call
    with wp.ScopedDevice(device), wp.ScopedCapture(device) as capture:
        call()
    return lambda: wp.capture_launch(capture.graph)


def update_deviation(batch: BatchServo, frames: int = 60) -> float:
    """Largest entry of J's difference from the CPU's filter given the same flow and joint steps, by J's largest."""
    one = JacobianFilter(batch.filter.options, wp.get_device("cpu"), batch.world.threads)
    one.restore(batch.filter.stored())
    for _ in range(frames):
        batch.frame()
        one.stage(wp.array(batch.flow.flow.numpy(), dtype=wp.vec2, device="cpu"))
        one.advance(batch.filter.dq.numpy())
    ours, theirs = one.present().numpy(), batch.jacobian.numpy()
    return float(np.abs(ours - theirs).max() / np.abs(ours).max())


def make_case(arguments: argparse.Namespace, worlds: int) -> BatchCase:
    """What the arguments describe, with that many worlds."""
    return BatchCase(
        robot=arguments.robot,
        worlds=worlds,
        targets=arguments.targets,
        seed=arguments.seed,
        flow=arguments.flow,
        order=arguments.order,
        randomization=RANDOMIZED if arguments.randomize else DomainRandomization(),
        episode=EpisodeOptions(babble_seconds=arguments.babble),
    )


def make_batch(arguments: argparse.Namespace, worlds: int) -> BatchServo:
    """The batch that the arguments describe, with that many worlds."""
    return make_case(arguments, worlds).batch(Rank(), arguments.device)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description="The whole servo loop of many simulated robots.")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N (default: auto)")
    parser.add_argument("--worlds", type=int, default=1024, help="worlds (default: 1024)")
    parser.add_argument("--targets", type=int, default=1, help="targets a world (default: 1)")
    parser.add_argument("--babble", type=float, default=10.0, metavar="S", help="seconds of babbling (default: 10)")
    parser.add_argument("--robot", default="arm", help="arm, planar or an MJCF file (default: arm)")
    parser.add_argument(
        "--flow", default="farneback-guided-warp", help="method of BatchFlow (default: farneback-guided-warp)"
    )
    parser.add_argument("--order", type=int, default=1, help="order of the filter (default: 1)")
    parser.add_argument("--seed", type=int, default=0, help="of everything (default: 0)")
    parser.add_argument("--randomize", action="store_true", help="links, textures, lights and camera differ by world")
    parser.add_argument("--speed-only", action="store_true", help="leave out the reaches")
    parser.add_argument(
        "--gpus", metavar="N,M", help="frames/s of the same worlds shared by that many processes, a GPU each; no more"
    )
    add_report_arguments(parser)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    if arguments.gpus:
        return finish(shared_metrics(arguments), arguments)
    device = resolve_device(arguments.device)
    worlds = arguments.worlds
    label = f"{worlds} worlds, {device.alias}"
    before = device.free_memory if device.is_cuda else 0
    started = time.perf_counter()
    batch = make_batch(arguments, worlds)
    for _ in range(4):
        batch.frame()
    wp.synchronize_device(device)
    print(f"made and compiled in {time.perf_counter() - started:.1f} s", flush=True)
    metrics = []
    if device.is_cuda:
        used = (before - device.free_memory) / 2**30
        metrics.append(Metric(f"device memory, {label}", used, "GiB", "lower", 0.02))
    metrics += speed_metrics(batch, label)
    del batch
    if not arguments.speed_only:
        metrics += reach_metrics(arguments, device)
    return finish(metrics, arguments)


def finish(metrics: list[Metric], arguments: argparse.Namespace) -> int:
    """Print and write the metrics and hold them to the gate; the exit code."""
    gate, arguments.gate = arguments.gate, None
    code = report(metrics, arguments)
    if gate is None:
        return code
    before = json.loads(gate.read_text(encoding="utf-8"))
    good, lines = hold_to(metrics, provenance(arguments, leave_out=("json", "gate")), before, gate.name)
    rows = beside(metrics, before)
    if rows:
        print("\n" + table(("metric", "was", "is", "unit", "by"), rows))
    for line in lines:
        print(line, file=sys.stdout if good else sys.stderr)
    return 0 if good else 1


def shared_metrics(arguments: argparse.Namespace) -> list[Metric]:
    """Frames a second of the worlds shared by several processes, each from the same moment on."""
    try:
        counts = [check_whole("--gpus", int(text), least=1) for text in arguments.gpus.split(",")]
    except ValueError:
        raise DenseVSError(f"--gpus is {arguments.gpus!r}; expected whole numbers such as 1,2") from None
    metrics, first = [], 0.0
    for count in counts:
        barrier = multiprocessing.get_context("spawn").Barrier(count)
        rates = run_ranks(shared_rate, count, (make_case(arguments, arguments.worlds), arguments.device, barrier))
        label = f"{arguments.worlds} worlds, {count} processes, {arguments.device}"
        metrics.append(Metric(f"closed loop, {label}", sum(rates), "frames/s", "higher", 0.05))
        first = first or sum(rates)
        metrics.append(Metric(f"by that of {counts[0]} processes, {label}", sum(rates) / first, "x", "higher", 0.05))
    return metrics


def shared_rate(rank: Rank, case: BatchCase, device: str, barrier: Any) -> float:
    """Frames a second of this process's worlds, while the others compute theirs."""
    wp.config.log_level = wp.LOG_ERROR
    wp.set_device(resolve_device(rank.device(device)))
    batch = case.batch(rank, device)
    frame = seconds_per_call(batch.frame, batch.device)
    frames = max(3, round(MEASURED_SECONDS / frame))
    barrier.wait(LONGEST_START)
    started = time.perf_counter()
    batch.run(frames)
    wp.synchronize_device(batch.device)
    return frames * batch.world.shape[0] / (time.perf_counter() - started)


def speed_metrics(batch: BatchServo, label: str) -> list[Metric]:
    """Whole frames, the stages by themselves, and what lies between an image and the command."""
    device, worlds = batch.device, batch.world.shape[0]
    frame = seconds_per_call(batch.frame, device)
    metrics = [Metric(f"closed loop, {label}", worlds / frame, "frames/s", "higher", 0.05)]
    stages = batch.stages
    now = batch.filter.now

    def from_image_to_command() -> None:
        for name in ("flow", "update", "tracking", "command"):
            stages[name]()

    for name, stage in {**stages, "image to command": from_image_to_command}.items():
        seconds = seconds_per_call(captured(stage, device), device, 0.2)
        batch.filter.now = now
        metrics.append(Metric(f"{name}, {label}", 1e3 * seconds, "ms", "lower", 0.1))
    return metrics


def reach_metrics(arguments: argparse.Namespace, device: wp.Device) -> list[Metric]:
    """Whether the loop closes, and whether a CPU comes to the same J."""
    worlds = arguments.worlds
    label = f"{worlds} worlds, {device.alias}"
    batch = make_batch(arguments, worlds)
    started = time.perf_counter()
    batch.run()
    seconds = time.perf_counter() - started
    results = batch.results()
    errors = results.true_error_px
    metrics = [
        Metric(f"share of reaches within {WITHIN_PX:g} px, {label}", np.mean(errors < WITHIN_PX), "1", "higher", 0.01),
        Metric(f"share reached, {label}", np.mean(results.outcome == ReachEnd.REACHED), "1", "higher", 0.01),
        Metric(f"share lost, {label}", np.mean(results.outcome == ReachEnd.LOST), "1", "lower", 0.01),
        Metric(f"true error, median, {label}", float(np.nanmedian(errors)), "px", "lower", 0.05),
        Metric(f"true error, 95th percentile, {label}", float(np.nanpercentile(errors, 95)), "px", "lower", 0.1),
        Metric(f"worlds restarted, {label}", float(np.sum(results.restarts > 0)), "1", "lower", 0.0),
        Metric(f"whole run with readings, {label}", batch.frames * worlds / seconds, "frames/s", "higher", 0.1),
    ]
    del batch
    few = make_batch(arguments, min(worlds, 4))
    few.run(60)
    deviation = update_deviation(few)
    metrics.append(Metric(f"J against the CPU's, same inputs, {device.alias}", deviation, "1", "lower", 1.0))
    few.run(max(0, round(30 * arguments.babble) - few.frames))
    medians = [error.median for error in few.jacobian_errors()]
    metrics.append(Metric(f"J error after babbling, median, {device.alias}", float(np.median(medians)), "1", "lower"))
    return metrics


if __name__ == "__main__":
    raise SystemExit(main())
