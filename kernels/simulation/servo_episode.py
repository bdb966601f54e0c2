"""What each world of a batch is at: it babbles, is given its point, reaches one target after another, and rests.

Every world goes through these phases at its own pace; nothing of it is decided on the host, so a frame can be
captured in a CUDA graph. A reach ends when the tracked point has stayed within ``tolerance`` of its target for
``settle_frames`` frames, when it has taken ``max_frames``, or when the point is lost, as the servo would go on blind.
The point's true place serves to measure the error at the end; it decides nothing.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

BABBLING, REACHING, RESTING = 0, 1, 2
PENDING, REACHED, MISSED, LOST = 0, 1, 2, 3


@dataclass(frozen=True)
class EpisodeState:
    """Progress of B worlds with K targets each."""

    phase: Any  # (B,) int: BABBLING, REACHING or RESTING
    age: Any  # (B,) int, frames in the phase, or in the present reach
    settled: Any  # (B,) int, frames within the tolerance
    target_index: Any  # (B,) int
    targets: Any  # (B, K) vec2d [px]
    target: Any  # (B,) vec2d, the present one
    point: Any  # (B, 1) vec2d, the tracked point
    point_of_world: Any  # (B,) vec2d, the same memory
    point32: Any  # (B, 1) vec2, the same place
    outcome: Any  # (B, K) int: PENDING, REACHED, MISSED or LOST
    frames: Any  # (B, K) int, frames that the reach took
    error: Any  # (B, K) float, tracked point to target at its end [px]
    true_error: Any  # (B, K) float, true point to target [px]
    babbling: Any  # (B,) int, 1 in worlds that babble in this frame
    defining: Any  # (B,) int, 1 in worlds whose point is defined in this frame
    reaching: Any  # (B,) int, 1 in worlds that servo in this frame

    @classmethod
    def empty(cls, targets: Any, device: Any) -> "EpisodeState":
        """All worlds about to babble; ``targets`` (B, K, 2) [px]."""
        worlds, count = targets.shape[:2]

        def whole(*shape: int) -> wp.array:
            return wp.zeros(shape, dtype=int, device=device)

        point: Any = wp.zeros((worlds, 1), dtype=wp.vec2d, device=device)

        return cls(
            phase=whole(worlds),
            age=whole(worlds),
            settled=whole(worlds),
            target_index=whole(worlds),
            targets=wp.array(targets, dtype=wp.vec2d, device=device),
            target=wp.zeros(worlds, dtype=wp.vec2d, device=device),
            point=point,
            point_of_world=point.reshape((worlds,)),
            point32=wp.zeros((worlds, 1), dtype=wp.vec2, device=device),
            outcome=whole(worlds, count),
            frames=whole(worlds, count),
            error=wp.full((worlds, count), wp.nan, dtype=float, device=device),
            true_error=wp.full((worlds, count), wp.nan, dtype=float, device=device),
            babbling=whole(worlds),
            defining=whole(worlds),
            reaching=whole(worlds),
        )


def advance_episodes(
    state: EpisodeState,
    tracked: wp.array,
    lost: wp.array,
    true_points: wp.array,
    restarted: wp.array,
    *,
    babble_frames: int,
    tolerance: float,
    settle_frames: int,
    max_frames: int,
) -> None:
    """Take note of one more frame.

    Args:
        state: changed.
        tracked: vec2d ``(B, 1)``, tracked points [px].
        lost: int ``(B, 1)``.
        true_points: vec2d ``(B, 1)`` [px].
        restarted: int ``(B,)``, not 0 in worlds that begin anew: they babble, and go on with the target that they had.
        babble_frames: frames of babbling before the point is defined.
        tolerance: distance that counts as there [px].
        settle_frames: frames it has to stay there.
        max_frames: frames after which a reach is given up.
    """
    wp.launch(
        advance_episodes_kernel,
        dim=state.phase.shape,
        inputs=[
            tracked,
            lost,
            true_points,
            restarted,
            state.targets,
            babble_frames,
            tolerance,
            settle_frames,
            max_frames,
        ],
        outputs=[
            state.phase,
            state.age,
            state.settled,
            state.target_index,
            state.target,
            state.point,
            state.point32,
            state.outcome,
            state.frames,
            state.error,
            state.true_error,
            state.babbling,
            state.defining,
            state.reaching,
        ],
        device=state.phase.device,
    )


@wp.kernel
def advance_episodes_kernel(
    # In:
    tracked_in: wp.array2d(dtype=wp.vec2d),
    lost_in: wp.array2d(dtype=int),
    true_points_in: wp.array2d(dtype=wp.vec2d),
    restarted_in: wp.array(dtype=int),
    targets_in: wp.array2d(dtype=wp.vec2d),
    babble_frames: int,
    tolerance: wp.float64,
    settle_frames: int,
    max_frames: int,
    # Out:
    phase_out: wp.array(dtype=int),
    age_out: wp.array(dtype=int),
    settled_out: wp.array(dtype=int),
    index_out: wp.array(dtype=int),
    target_out: wp.array(dtype=wp.vec2d),
    point_out: wp.array2d(dtype=wp.vec2d),
    point32_out: wp.array2d(dtype=wp.vec2),
    outcome_out: wp.array2d(dtype=int),
    frames_out: wp.array2d(dtype=int),
    error_out: wp.array2d(dtype=float),
    true_error_out: wp.array2d(dtype=float),
    babbling_out: wp.array(dtype=int),
    defining_out: wp.array(dtype=int),
    reaching_out: wp.array(dtype=int),
):
    """A thread a world."""
    world = wp.tid()
    phase = phase_out[world]
    age = age_out[world] + 1
    index = index_out[world]
    point = tracked_in[world, 0]
    defining = int(0)
    if restarted_in[world] != 0:
        age = 0
        settled_out[world] = 0
        if phase != wp.static(RESTING):
            phase = wp.static(BABBLING)
    elif phase == wp.static(BABBLING) and age >= babble_frames:
        phase = wp.static(REACHING)
        age = 0
        settled_out[world] = 0
        defining = 1
        point = true_points_in[world, 0]
    elif phase == wp.static(REACHING):
        error = wp.length(targets_in[world, index] - point)
        settled = wp.where(error <= tolerance, settled_out[world] + 1, 0)
        lost = lost_in[world, 0] != 0
        outcome = int(wp.static(PENDING))
        if settled >= settle_frames:
            outcome = wp.static(REACHED)
        elif age >= max_frames:
            outcome = wp.static(MISSED)
        if lost or not wp.isfinite(error):
            outcome = wp.static(LOST)
        if outcome != wp.static(PENDING):
            outcome_out[world, index] = outcome
            frames_out[world, index] = age
            error_out[world, index] = float(error)
            true_error_out[world, index] = float(wp.length(targets_in[world, index] - true_points_in[world, 0]))
            index += 1
            age = 0
            settled = 0
            if outcome == wp.static(LOST) and index < targets_in.shape[1]:
                # The point is defined anew, as a user would before going on.
                defining = 1
                point = true_points_in[world, 0]
        settled_out[world] = settled
        if index >= targets_in.shape[1]:
            phase = wp.static(RESTING)
            index = targets_in.shape[1] - 1
    phase_out[world] = phase
    age_out[world] = age
    index_out[world] = index
    target_out[world] = targets_in[world, index]
    point_out[world, 0] = point
    point32_out[world, 0] = wp.vec2(float(point[0]), float(point[1]))
    babbling_out[world] = wp.where(phase == wp.static(BABBLING), 1, 0)
    defining_out[world] = defining
    reaching_out[world] = wp.where(phase == wp.static(REACHING), 1, 0)
