"""The depth row of the image Jacobian: depth and its derivatives by the joints at every pixel (beyond DIJE).

A pixel's state is (Z, D, H): the depth Z [m] of the surface point seen there, its row D = dZ/dq of N columns [m/rad],
and in order 2 the N (N + 1) / 2 columns of H_ij = dD_i / dq_j, as in ``covariance.py``, all at the present posture.
A joint step s takes it to

    Z <- Z + D s + 1/2 s^T H s,    D <- D + H s,

the state moves in the image as J does, DIJE (14), and a depth image measures Z. Keeping Z, rather than learning from
differences of two depth images, makes the noise of an image count once and lets holes be bridged.

An image of depth jumps where one surface ends before another. The state is never averaged across a jump. Where the
depth that is measured is not the one that is expected, another surface has come there, the one of a neighbor that
expects this depth: its state is taken over, else the pixel begins anew.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from dense_vs.kernels.image.bilinear import bilinear, bilinear_taps
from dense_vs.kernels.jacobian.covariance import hessian_column, state_columns
from dense_vs.kernels.jacobian.moved_pixels import pixel_shift

wp.set_module_options({"enable_backward": False})

RINGS = wp.constant(3)  # neighbors are asked at distances of 1, 2 and 4 px
AROUND = wp.constant(9)  # in eight directions, and none


def depth_columns(joints: int, order: int) -> int:
    """Columns of a pixel's state: Z, N of D, and N (N + 1) / 2 of H where ``order`` is 2."""
    return 1 + state_columns(joints, order)


@wp.func
def is_depth(z: float) -> bool:
    """Whether a pixel of a depth image says anything; not where it is 0, NaN or infinite."""
    return wp.isfinite(z) and z > 0.0


@cache
def depth_state_functions(joints: int, order: int) -> SimpleNamespace:
    """Types ``State`` and ``JointVector``, functions ``state_at`` and ``expected_state``."""
    State = wp.types.vector(depth_columns(joints, order), wp.float32)
    JointVector = wp.types.vector(joints, wp.float32)
    sample = bilinear(State)

    @wp.func
    def state_at(image: wp.array3d(dtype=State), world: int, x: int, y: int, shift: wp.vec2, jump: float) -> State:
        """State at (x, y) - shift: bilinear on one surface, that of the nearest pixel where depth jumps."""
        width = image.shape[2]
        height = image.shape[1]
        taps = bilinear_taps(x, y, shift, width, height)
        upper_left = image[world, taps.top, taps.left][0]
        upper_right = image[world, taps.top, taps.right][0]
        lower_left = image[world, taps.bottom, taps.left][0]
        lower_right = image[world, taps.bottom, taps.right][0]
        nearest = wp.min(wp.min(upper_left, upper_right), wp.min(lower_left, lower_right))
        farthest = wp.max(wp.max(upper_left, upper_right), wp.max(lower_left, lower_right))
        if nearest > 0.0 and farthest - nearest <= jump * nearest:
            return sample(image, world, taps)
        column = taps.right
        row = taps.bottom
        if taps.upper_left + taps.lower_left >= 0.5:
            column = taps.left
        if taps.upper_left + taps.upper_right >= 0.5:
            row = taps.top
        return image[world, row, column]

    @wp.func
    def after_step(before: State, dq: JointVector) -> State:
        """The state after a joint step; nothing is known any more where its depth is none."""
        after = before
        z = before[0]
        for i in range(wp.static(joints)):
            slope = before[1 + i]
            if wp.static(order == 2):
                change = float(0.0)
                for m in range(wp.static(joints)):
                    change += before[1 + hessian_column(i, m, wp.static(joints))] * dq[m]
                after[1 + i] = slope + change
                slope += 0.5 * change
            z += slope * dq[i]
        after[0] = z
        if before[0] > 0.0 and not is_depth(z):
            return State()
        if before[0] == 0.0:
            after[0] = 0.0
        return after

    @wp.func
    def expected_state(
        image: wp.array3d(dtype=State),
        shift: wp.array3d(dtype=wp.vec2),
        dq: JointVector,
        world: int,
        x: int,
        y: int,
        iterations: int,
        jump: float,
    ) -> State:
        """State of the surface point that is at (x, y) after the step, DIJE (14)."""
        moved = pixel_shift(shift, world, x, y, iterations, image.shape[2], image.shape[1])
        return after_step(state_at(image, world, x, y, moved, jump), dq)

    return SimpleNamespace(State=State, JointVector=JointVector, state_at=state_at, expected_state=expected_state)


@cache
def depth_state_kernels(joints: int, order: int) -> SimpleNamespace:
    """Types ``State`` and ``JointVector``, kernels ``update_depth`` and ``sample_depth``."""
    functions = depth_state_functions(joints, order)
    State, JointVector = functions.State, functions.JointVector
    state_at, expected_state = functions.state_at, functions.expected_state
    kernel = wp.kernel(module=f"{__name__}_{joints}_{order}", enable_backward=False)

    @wp.func
    def neighbors_state(
        image: wp.array3d(dtype=State),
        shift: wp.array3d(dtype=wp.vec2),
        dq: JointVector,
        world: int,
        x: int,
        y: int,
        iterations: int,
        jump: float,
        z: float,
    ) -> State:
        """State of the nearest neighbor that expects depth z; zero where none does."""
        found = State()
        least = jump * z
        rings = int(RINGS)  # variables, so that the loops are not written out
        around = int(AROUND)
        for ring in range(rings):
            if found[0] == 0.0:
                for k in range(around):
                    column = x + ((k % 3) - 1) * (1 << ring)
                    row = y + ((k // 3) - 1) * (1 << ring)
                    if k != 4 and column >= 0 and row >= 0 and column < image.shape[2] and row < image.shape[1]:
                        other = expected_state(image, shift, dq, world, column, row, iterations, jump)
                        if other[0] > 0.0 and wp.abs(z - other[0]) <= least:
                            found = other
                            least = wp.abs(z - other[0])
        return found

    @kernel
    def update_depth(
        row_begin: int,
        column_step: int,
        # In:
        state_in: wp.array3d(dtype=State),
        shift_in: wp.array3d(dtype=wp.vec2),  # J dq [px]
        iterations: int,
        dq_in: wp.array(dtype=JointVector),  # (worlds,)
        depth_in: wp.array3d(dtype=float),  # (worlds, H, W) [m], 0, NaN or infinite where it is not known
        measured: int,  # 0 where there is no depth image: the state is moved only
        jump: float,  # share of a depth by which it changes from one surface to another
        gain_in: wp.array(dtype=State),  # (worlds,)
        # Out:
        state_out: wp.array3d(dtype=State),
    ):
        """State <- expected state + K (z - expected depth), as DIJE (10)."""
        world, row, column = wp.tid()
        y = row_begin + row
        dq = dq_in[world]
        for x in range(column, state_in.shape[2], column_step):
            state = expected_state(state_in, shift_in, dq, world, x, y, iterations, jump)
            z = depth_in[world, y, x]
            if measured != 0 and is_depth(z):
                error = z - state[0]
                if state[0] > 0.0 and wp.abs(error) <= jump * z:
                    state = state + gain_in[world] * error
                else:
                    state = neighbors_state(state_in, shift_in, dq, world, x, y, iterations, jump, z)
                    state[0] = z
            state_out[world, y, x] = state

    @kernel
    def sample_depth(
        # In:
        state_in: wp.array3d(dtype=State),
        points_in: wp.array2d(dtype=wp.vec2),
        jump: float,
        # Out:
        state_out: wp.array2d(dtype=State),
    ):
        """State at (worlds, K) points, DIJE (16), not averaged across a jump of depth."""
        world, point = wp.tid()
        state_out[world, point] = state_at(state_in, world, 0, 0, -points_in[world, point], jump)

    return SimpleNamespace(State=State, JointVector=JointVector, update_depth=update_depth, sample_depth=sample_depth)
