"""A gray image sampled by a cubic B-spline without prefilter: smooth derivatives, the same slight blur everywhere."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def spline_weights(a: float) -> wp.vec4:
    """Cubic B-spline at the pixels -1, 0, 1, 2 seen from a in [0, 1)."""
    b = 1.0 - a
    aa = a * a
    bb = b * b
    return wp.vec4(b * bb, aa * (3.0 * a - 6.0) + 4.0, bb * (3.0 * b - 6.0) + 4.0, a * aa) * (1.0 / 6.0)


@wp.func
def spline_slopes(a: float) -> wp.vec4:
    """Derivatives of :func:`spline_weights` by a."""
    b = 1.0 - a
    return wp.vec4(-b * b, a * (3.0 * a - 4.0), b * (4.0 - 3.0 * b), a * a) * 0.5


@wp.func
def sample_spline(image: wp.array3d(dtype=wp.uint8), world: int, left: int, top: int, a: float, b: float) -> wp.vec3:
    """Gray value less 128 at (left + a, top + b) and its derivatives by x and y.

    Beyond the image's border its nearest pixel answers.
    """
    height = image.shape[1]
    width = image.shape[2]
    column_weights = spline_weights(a)
    column_slopes = spline_slopes(a)
    row_weights = spline_weights(b)
    row_slopes = spline_slopes(b)
    x0 = wp.clamp(left - 1, 0, width - 1)
    x1 = wp.clamp(left, 0, width - 1)
    x2 = wp.clamp(left + 1, 0, width - 1)
    x3 = wp.clamp(left + 2, 0, width - 1)
    value = float(-128.0)
    slope_x = float(0.0)
    slope_y = float(0.0)
    for row in range(4):
        y = wp.clamp(top - 1 + row, 0, height - 1)
        pixels = wp.vec4(
            float(image[world, y, x0]),
            float(image[world, y, x1]),
            float(image[world, y, x2]),
            float(image[world, y, x3]),
        )
        across = wp.dot(column_weights, pixels)
        value += row_weights[row] * across
        slope_x += row_weights[row] * wp.dot(column_slopes, pixels)
        slope_y += row_slopes[row] * across
    return wp.vec3(value, slope_x, slope_y)
