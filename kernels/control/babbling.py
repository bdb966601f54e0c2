"""Motor babbling in many worlds: each joint of each follows its own smoothed Ornstein-Uhlenbeck process.

With dt the rate times frame time over time constant, z normal, a the amplitude, and M the second moments of the N
joints' steps so far, their noise n and their offset o from their posture take the steps

    k = (I - M / (2 tr M))^2N z,                n <- n - dt n + sqrt(2 dt) k |z| / |k|,
    o <- clamp(o + dt (sqrt(2) a n - o), -3 a, 3 a),

so that what has moved less so far is kicked harder.

Each world's rate falls at once where its image moves faster than ``max_flow`` and recovers slowly. Image motion is
the 99th percentile of max(|u|, |v|) over every fourth pixel. Sorting it per world would be dear; the rate only depends
on the percentile between ``max_flow`` and twice that, so a histogram of that range stands for it. It gives the
higher of the two samples that the percentile lies between: exactly as to whether that is above ``max_flow``, else
within half a bin, 0.8 % of ``max_flow``.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

BINS = 64  # between max_flow and twice max_flow
COUNTS = BINS + 4  # pixels that are slower, the bins, pixels that are faster, all pixels; rows looked at
STRIDE = 4  # px between the pixels that are looked at
PARTS = 8  # of a row that a GPU's threads look at
PERCENTILE = 0.99
SPEEDS_UP = 1.05  # by which the pace grows in a frame that allows it


@dataclass(frozen=True)
class BabblingState:
    """The random processes of all worlds."""

    kick: Any  # (worlds, N) the last one; and between
    turned: Any  # (worlds, N)
    noise: Any  # (worlds, N)
    offset: Any  # (worlds, N) rad
    moments: Any  # (worlds, N, N) sum of dq dq^T [rad^2]
    rate: Any  # (worlds,)
    counts: Any  # (worlds, COUNTS) int, histogram of the image motion since the last step
    seeds: Any  # (worlds,) uint32
    draws: Any  # (worlds,) uint32, steps taken so far

    @classmethod
    def empty(cls, seeds: Any, joints: int, device: Any) -> "BabblingState":
        """At rest, at rate 0.5; ``seeds`` holds a whole number a world."""
        worlds = len(seeds)
        return cls(
            kick=wp.zeros((worlds, joints), dtype=float, device=device),
            turned=wp.zeros((worlds, joints), dtype=float, device=device),
            noise=wp.zeros((worlds, joints), dtype=float, device=device),
            offset=wp.zeros((worlds, joints), dtype=float, device=device),
            moments=wp.zeros((worlds, joints, joints), dtype=float, device=device),
            rate=wp.full(worlds, 0.5, dtype=float, device=device),
            counts=wp.zeros((worlds, COUNTS), dtype=int, device=device),
            seeds=wp.array(seeds, dtype=wp.uint32, device=device),
            draws=wp.zeros(worlds, dtype=wp.uint32, device=device),
        )


def restart_babbling(state: BabblingState, where: wp.array) -> None:
    """Put the worlds where ``where`` is not 0 back to rest; their random streams go on."""
    wp.launch(
        restart_babbling_kernel,
        dim=state.rate.shape,
        inputs=[where],
        outputs=[state.noise, state.offset, state.moments, state.rate, state.counts],
        device=where.device,
    )


def watch_flow(state: BabblingState, flow: wp.array, *, max_flow: float) -> None:
    """Count how fast the images move; the next step takes its pace from it.

    Args:
        state: its counts are added to.
        flow: vec2 ``(worlds, H, W)`` [px]; what is not finite does not count.
        max_flow: image motion to slow down to [px per frame].
    """
    worlds, height, _ = flow.shape
    rows = (height + STRIDE - 1) // STRIDE
    device: Any = flow.device
    parts = PARTS if device.is_cuda else 1
    wp.launch(
        count_speeds_kernel,
        dim=(worlds, rows, parts),
        inputs=[flow, parts, max_flow],
        outputs=[state.counts],
        device=device,
    )


def babbling_steps(
    state: BabblingState,
    positions: wp.array,
    limits: wp.array,
    where: wp.array,
    steps_out: wp.array,
    *,
    amplitude: float,
    time_constant: float,
    frame_time: float,
) -> None:
    """The next joint steps, in the chosen worlds.

    Args:
        state: advanced in the chosen worlds; the counts of all are reset. The pace changes where :func:`watch_flow`
            was called since the last step.
        positions: float32 ``(worlds, N)``, where the joints are [rad].
        limits: vec2 ``(N,)``, least and greatest position [rad], which the steps keep; the process goes on beyond.
        where: int ``(worlds,)``, not 0 in the worlds to step; the others' steps stay as they are.
        steps_out: float32 ``(worlds, N)`` [rad].
        amplitude: standard deviation of a joint's excursion [rad].
        time_constant: of the random process [s].
        frame_time: time between frames [s].
    """
    wp.launch(
        babbling_steps_kernel,
        dim=state.rate.shape,
        inputs=[positions, limits, where, state.seeds, amplitude, frame_time / time_constant],
        outputs=[
            state.kick,
            state.turned,
            state.noise,
            state.offset,
            state.moments,
            state.rate,
            state.counts,
            state.draws,
            steps_out,
        ],
        device=positions.device,
    )


@wp.kernel
def restart_babbling_kernel(
    # In:
    where_in: wp.array(dtype=int),
    # Out:
    noise_out: wp.array2d(dtype=float),
    offset_out: wp.array2d(dtype=float),
    moments_out: wp.array3d(dtype=float),
    rate_out: wp.array(dtype=float),
    counts_out: wp.array2d(dtype=int),
):
    """The state of a world that has not moved."""
    world = wp.tid()
    if where_in[world] == 0:
        return
    for i in range(noise_out.shape[1]):
        noise_out[world, i] = 0.0
        offset_out[world, i] = 0.0
        for j in range(noise_out.shape[1]):
            moments_out[world, i, j] = 0.0
    rate_out[world] = 0.5
    for bin in range(counts_out.shape[1]):
        counts_out[world, bin] = 0


@wp.kernel
def count_speeds_kernel(
    # In:
    flow_in: wp.array3d(dtype=wp.vec2),
    parts: int,
    max_flow: float,
    # Out:
    counts_out: wp.array2d(dtype=int),
):
    """Histogram of the speeds of a part of a row; what is slow, nearly all, is counted in a register."""
    world, row, part = wp.tid()
    y = row * wp.static(STRIDE)
    slow = int(0)
    known = int(0)
    for x in range(part * wp.static(STRIDE), flow_in.shape[2], parts * wp.static(STRIDE)):
        u = flow_in[world, y, x]
        if wp.isfinite(u[0]) and wp.isfinite(u[1]):
            known += 1
            speed = wp.max(wp.abs(u[0]), wp.abs(u[1]))
            if speed <= max_flow:
                slow += 1
            else:
                over = wp.min((speed / max_flow - 1.0) * float(wp.static(BINS)), float(wp.static(BINS)))
                wp.atomic_add(counts_out, world, 1 + int(over), 1)
    wp.atomic_add(counts_out, world, 0, slow)
    wp.atomic_add(counts_out, world, wp.static(COUNTS - 2), known)
    wp.atomic_add(counts_out, world, wp.static(COUNTS - 1), 1)


@wp.func
def adapted_rate(rate: float, counts: wp.array2d(dtype=int), world: int) -> float:
    """Slower at once where the percentile is above max_flow, a little faster where it is not."""
    known = counts[world, wp.static(COUNTS - 2)]
    rank = wp.static(PERCENTILE) * float(known - 1)
    below = counts[world, 0]
    if known == 0 or float(below - 1) >= rank:
        return wp.min(rate * wp.static(SPEEDS_UP), 1.0)
    excess = float(2.0)
    bin = int(0)
    while bin < wp.static(BINS):
        below += counts[world, 1 + bin]
        if float(below - 1) >= rank:
            excess = 1.0 + (float(bin) + 0.5) / float(wp.static(BINS))
            bin = wp.static(BINS)
        bin += 1
    return wp.max(rate / excess, 0.02)


@wp.func
def balance(
    kick: wp.array2d(dtype=float), turned: wp.array2d(dtype=float), moments: wp.array3d(dtype=float), world: int
):
    """Turn a world's kick toward what has moved less so far; it stays as strong."""
    joints = kick.shape[1]
    trace = float(0.0)
    before = float(0.0)
    for i in range(joints):
        trace += moments[world, i, i]
        before += kick[world, i] * kick[world, i]
    if trace > 0.0:
        for _ in range(2 * joints):
            for i in range(joints):
                share = float(0.0)
                for j in range(joints):
                    share += moments[world, i, j] * kick[world, j]
                turned[world, i] = kick[world, i] - share / (2.0 * trace)
            for i in range(joints):
                kick[world, i] = turned[world, i]
        after = float(0.0)
        for i in range(joints):
            after += kick[world, i] * kick[world, i]
        for i in range(joints):
            kick[world, i] = kick[world, i] * wp.sqrt(before / after)


@wp.kernel
def babbling_steps_kernel(
    # In:
    positions_in: wp.array2d(dtype=float),
    limits_in: wp.array(dtype=wp.vec2),
    where_in: wp.array(dtype=int),
    seeds_in: wp.array(dtype=wp.uint32),
    amplitude: float,
    frames: float,  # frame time over time constant
    # Out:
    kick_out: wp.array2d(dtype=float),
    turned_out: wp.array2d(dtype=float),
    noise_out: wp.array2d(dtype=float),
    offset_out: wp.array2d(dtype=float),
    moments_out: wp.array3d(dtype=float),
    rate_out: wp.array(dtype=float),
    counts_out: wp.array2d(dtype=int),
    draws_out: wp.array(dtype=wp.uint32),
    steps_out: wp.array2d(dtype=float),
):
    """Pace, noise and offset of a world's joints."""
    world = wp.tid()
    if where_in[world] != 0:
        joints = noise_out.shape[1]
        rate = rate_out[world]
        if counts_out[world, wp.static(COUNTS - 1)] > 0:
            rate = adapted_rate(rate, counts_out, world)
            rate_out[world] = rate
        dt = wp.min(rate * frames, 0.5)
        draw = draws_out[world]
        draws_out[world] = draw + wp.uint32(1)
        random = wp.rand_init(int(seeds_in[world]), int(draw))
        for j in range(joints):
            kick_out[world, j] = wp.randn(random)
        balance(kick_out, turned_out, moments_out, world)
        for j in range(joints):
            noise = noise_out[world, j]
            noise += wp.sqrt(2.0 * dt) * kick_out[world, j] - dt * noise
            noise_out[world, j] = noise
            offset = offset_out[world, j]
            moved = offset + dt * (wp.sqrt(2.0) * amplitude * noise - offset)
            moved = wp.clamp(moved, -3.0 * amplitude, 3.0 * amplitude)
            offset_out[world, j] = moved
            steps_out[world, j] = moved - offset
        for i in range(joints):
            for j in range(joints):
                moments_out[world, i, j] += steps_out[world, i] * steps_out[world, j]
        for j in range(joints):
            q = positions_in[world, j]
            # As ServoLoop does: a joint that is outside its limits is brought back.
            steps_out[world, j] = wp.clamp(q + steps_out[world, j], limits_in[j][0], limits_in[j][1]) - q
    for bin in range(wp.static(COUNTS)):
        counts_out[world, bin] = 0
