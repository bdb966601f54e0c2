"""What the search for a displacement begins with: a displacement known at another size of the image."""

import warp as wp

from dense_vs.kernels.flow.packed_expansion import read_pair

wp.set_module_options({"enable_backward": False})

GUESS_SCALE = 0.25  # size of a flow that is known before, by that of the image


@wp.func
def guess_at(coarser: wp.array3d(dtype=wp.vec2), world: int, y: int, x: int, ratio: wp.vec2, growth: float) -> wp.vec2:
    """Displacement of another size of the image, bilinear between the centers of its pixels, times ``growth``."""
    rows = coarser.shape[1]
    columns = coarser.shape[2]
    px = wp.clamp((float(x) + 0.5) * ratio[0] - 0.5, 0.0, float(columns - 1))
    py = wp.clamp((float(y) + 0.5) * ratio[1] - 0.5, 0.0, float(rows - 1))
    top = int(py)
    left = int(px)
    fy = py - float(top)
    fx = px - float(left)
    below = wp.min(top + 1, rows - 1)
    right = wp.min(left + 1, columns - 1)
    pixels = rows * columns
    upper = (1.0 - fx) * read_pair(coarser, world, pixels, top * columns + left)
    upper += fx * read_pair(coarser, world, pixels, top * columns + right)
    lower = (1.0 - fx) * read_pair(coarser, world, pixels, below * columns + left)
    lower += fx * read_pair(coarser, world, pixels, below * columns + right)
    return growth * ((1.0 - fy) * upper + fy * lower)


@wp.kernel
def begin_with_guess(
    row_begin: int,
    column_step: int,
    # In:
    guess_in: wp.array3d(dtype=wp.vec2),  # (worlds, any height, any width)
    ratio: wp.vec2,
    growth: float,
    restarted_in: wp.array(dtype=int),
    # Out:
    displacement_out: wp.array4d(dtype=float),
):
    """The displacement of a level to begin with; 0 in worlds that have no image before."""
    world, row, column = wp.tid()
    y = row_begin + row
    for x in range(column, displacement_out.shape[3], column_step):
        d = wp.vec2(0.0, 0.0)
        if restarted_in[world] == 0:
            d = guess_at(guess_in, world, y, x, ratio, growth)
        displacement_out[world, y, 0, x] = d[0]
        displacement_out[world, y, 1, x] = d[1]
