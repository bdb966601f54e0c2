"""Points placed on links by what was seen of each: Gauss and Newton's method (beyond the papers).

The error of a place counts as r / (1 + r), r its square over three times the noise: what is grossly wrong counts hardly
more than what is wrong. A step that does not lower the mean of that is taken back, and the next one is shorter.
"""

import warp as wp

from dense_vs.kernels.body.observed_points import ObservedPoints

wp.set_module_options({"enable_backward": False})

FARTHEST = 1e6  # px, of an error
BEHIND = 1e12  # times the noise, squared: error of a point that is not before the camera


@wp.struct
class Sums:
    """Of a point's places: robust errors, and the equations of a step."""

    robust: wp.float64
    matrix: wp.mat33d
    gradient: wp.vec3d


@wp.func
def outer(a: wp.vec3d) -> wp.mat33d:
    """The product of a vector with itself."""
    return wp.mat33d(
        a[0] * a[0], a[0] * a[1], a[0] * a[2],
        a[1] * a[0], a[1] * a[1], a[1] * a[2],
        a[2] * a[0], a[2] * a[1], a[2] * a[2],
    )  # fmt: skip


@wp.func
def of_point(
    seen: ObservedPoints,
    m: int,
    point: wp.vec3d,
    focal: wp.float64,
    noise: wp.float64,
    gross: wp.float64,
    nearest: wp.float64,
    errors_out: wp.array(dtype=wp.float64),
    says: bool,
) -> Sums:
    """Sums over the places of point m, were it at ``point``; with ``says`` their errors [px] are written too."""
    one = wp.float64(1.0)
    sums = Sums()
    link = seen.link_of[m]
    for o in range(seen.starts[m], seen.starts[m + 1]):
        image = seen.images[o]
        turn = seen.rotation[image, link]
        p = turn * point + seen.translation[image, link]
        depth = wp.max(p[2], nearest)
        x = p[0] / depth
        y = p[1] / depth
        direction = seen.directions[o]
        error = direction * (wp.vec2d(focal * x, focal * y) - seen.places[o])
        squared = wp.dot(error, error) / (noise * noise)
        if says:
            errors_out[o] = wp.min(wp.length(error), wp.float64(wp.static(FARTHEST)))
        root = one / (one + squared / (gross * gross))
        sums.robust += one - root
        if p[2] <= nearest:
            sums.robust += root
            root = one / (one + wp.float64(wp.static(BEHIND)) / (gross * gross))
        scale = root * focal / depth
        along_z = wp.vec3d(turn[2, 0], turn[2, 1], turn[2, 2])
        by_x = scale * (wp.vec3d(turn[0, 0], turn[0, 1], turn[0, 2]) - x * along_z)
        by_y = scale * (wp.vec3d(turn[1, 0], turn[1, 1], turn[1, 2]) - y * along_z)
        first = direction[0, 0] * by_x + direction[0, 1] * by_y
        second = direction[1, 0] * by_x + direction[1, 1] * by_y
        sums.matrix += outer(first) + outer(second)
        sums.gradient += root * (error[0] * first + error[1] * second)
    return sums


@wp.kernel
def place_points(
    # In:
    first: int,
    edges: wp.array(dtype=int),
    seen: ObservedPoints,
    focal: wp.float64,
    noise: wp.float64,
    gross: wp.float64,
    nearest: wp.float64,
    iterations: int,
    # In and out:
    points: wp.array(dtype=wp.vec3d),
    # Out:
    cost_out: wp.array(dtype=wp.float64),
    errors_out: wp.array(dtype=wp.float64),
):
    """Move the points of a part to where their places are explained best; their mean robust errors, 0 to 1.

    ``errors_out`` are those of the places [px], which count from the principal point. A point that was seen nowhere
    stays, at no cost.
    """
    part = first + wp.tid()
    one = wp.float64(1.0)
    for m in range(edges[part], edges[part + 1]):
        point = points[m]
        here = of_point(seen, m, point, focal, noise, gross, nearest, errors_out, False)
        damping = wp.float64(1.0e-3)
        for _ in range(iterations):
            matrix = here.matrix
            largest = wp.max(wp.max(matrix[0, 0], matrix[1, 1]), matrix[2, 2])
            for k in range(3):
                matrix[k, k] = matrix[k, k] + damping * matrix[k, k] + wp.float64(1.0e-9) * (one + largest)
            trial = point - wp.inverse(matrix) * here.gradient
            there = of_point(seen, m, trial, focal, noise, gross, nearest, errors_out, False)
            if there.robust <= here.robust:
                point = trial
                here = there
                damping = damping / wp.float64(5.0)
            else:
                damping = damping * wp.float64(10.0)
        points[m] = point
        last = of_point(seen, m, point, focal, noise, gross, nearest, errors_out, True)
        cost_out[m] = last.robust / wp.float64(wp.max(seen.starts[m + 1] - seen.starts[m], 1))
