"""Worlds of a batch that begin anew alone: those that were asked to, and those whose state is no longer a number."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def find_unsound_worlds(
    # In:
    positions_in: wp.array2d(dtype=float),  # (worlds, nq)
    velocities_in: wp.array2d(dtype=float),  # (worlds, nv)
    # Out:
    restarting_out: wp.array(dtype=int),  # (worlds,) set to 1 where a value is not finite, else left as it is
    unsound_out: wp.array(dtype=int),  # (worlds,) counted up there
):
    """Mark and count the worlds whose joint state holds a NaN or an infinity."""
    world = wp.tid()
    sound = bool(True)
    for i in range(positions_in.shape[1]):
        sound = sound and wp.isfinite(positions_in[world, i])
    for i in range(velocities_in.shape[1]):
        sound = sound and wp.isfinite(velocities_in[world, i])
    if not sound:
        restarting_out[world] = 1
        unsound_out[world] += 1


@wp.kernel
def restore_rows(
    # In:
    where_in: wp.array(dtype=int),  # (worlds,)
    rows_in: wp.array2d(dtype=float),  # (worlds, n), or (1, n) for all
    # Out:
    rows_out: wp.array2d(dtype=float),
):
    """Rows of the chosen worlds as they were at the start."""
    world, i = wp.tid()
    if where_in[world] != 0:
        rows_out[world, i] = rows_in[world % rows_in.shape[0], i]


@wp.kernel
def restart_clocks(
    # In:
    where_in: wp.array(dtype=int),
    # Out:
    time_out: wp.array(dtype=float),
):
    """Time 0 in the chosen worlds."""
    world = wp.tid()
    if where_in[world] != 0:
        time_out[world] = 0.0


@wp.kernel
def joint_motion_kernel(
    # In:
    qpos_in: wp.array2d(dtype=float),  # (worlds, nq)
    column_in: wp.array(dtype=int),  # (N,) columns of the chosen joints
    restarted_in: wp.array(dtype=int),  # (worlds,)
    # Out:
    positions_out: wp.array2d(dtype=float),  # (worlds, N); those of the frame before on entry
    joint_step_out: wp.array2d(dtype=float),  # (worlds, N), 0 in worlds that began anew
):
    """Joint positions and the step since the frame before."""
    world, n = wp.tid()
    position = qpos_in[world, column_in[n]]
    step = position - positions_out[world, n]
    joint_step_out[world, n] = wp.where(restarted_in[world] == 0, step, 0.0)
    positions_out[world, n] = position


def restore(where: wp.array, initial: wp.array, state: wp.array) -> None:
    """Put the rows of ``state`` (worlds, n) back to ``initial``, where ``where`` (worlds,) is not 0."""
    if state.size:
        wp.launch(restore_rows, dim=state.shape, inputs=[where, initial], outputs=[state], device=state.device)


def joint_motion(qpos: wp.array, columns: Any, restarted: Any, positions: wp.array, joint_step: wp.array) -> None:
    """Positions (worlds, N) and joint steps of the chosen joints; see :func:`joint_motion_kernel`."""
    wp.launch(
        joint_motion_kernel,
        dim=positions.shape,
        inputs=[qpos, columns, restarted],
        outputs=[positions, joint_step],
        device=qpos.device,
    )
