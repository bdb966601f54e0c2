"""Errors of tracks on a chain and the normal equations of its bundle adjustment, for a CPU, in C++ over vectors.

A point's own equations are summed where they stay in the cache, and those of the chain and the camera, which all points
share, once for each part of the points: the sums are the same for any number of threads. Written out as matrices, as
NumPy would have them, the slopes of 10,000 places take six times as long (beyond the papers).
"""

import warp as wp

from dense_vs.kernels.body.observed_points import ObservedPoints
from dense_vs.kernels.body.surface_image import BORDER

wp.set_module_options({"enable_backward": False})

LANES = 8  # doubles in the widest registers; rows are padded to them

# Where a point is seen: ``z`` its depth, ``nx, ny`` its place in px at a focal length of 1, ``ax, ay`` its place from
# the principal point without the lens's bend, ``grown`` what that grows by.
_SEEN = """
    const int image = seen.images.data[o];
    const double *R = rotation + ((size_t)image * links + link) * 9;
    const double *t = translation + ((size_t)image * links + link) * 3;
    const double px = R[0] * X[0] + R[1] * X[1] + R[2] * X[2] + t[0];
    const double py = R[3] * X[0] + R[4] * X[1] + R[5] * X[2] + t[1];
    const double z = R[6] * X[0] + R[7] * X[1] + R[8] * X[2] + t[2];
    const double nx = px / z, ny = py / z, ax = focal * nx, ay = focal * ny;
    const double squares = (ax * ax + ay * ay) / (corner * corner);
    const double limited = squares < %(border)r ? squares : %(border)r;
    const double grown = 1.0 + bend * limited;
    const double off_x = center_x + ax * grown - places[2 * o];
    const double off_y = center_y + ay * grown - places[2 * o + 1];
    const double *D = directions + 4 * o;
"""
# What the arrays hold, as numbers side by side.
_NUMBERS = """
    const int links = seen.translation.shape[1];
    const double *rotation = reinterpret_cast<const double*>(seen.rotation.data);
    const double *translation = reinterpret_cast<const double*>(seen.translation.data);
    const double *places = reinterpret_cast<const double*>(seen.places.data);
    const double *directions = reinterpret_cast<const double*>(seen.directions.data);
    const double *position = reinterpret_cast<const double*>(points.data);
    const double focal = camera.data[0], center_x = camera.data[1], center_y = camera.data[2];
    const double bend = camera.data[3], corner = camera.data[4];
"""
_ERRORS = """
#if !defined(__CUDA_ARCH__)
    %(numbers)s
    for (int m = first; m < last; ++m) {
        const double *X = position + 3 * m;
        const int link = seen.link_of.data[m];
        for (int o = seen.starts.data[m]; o < seen.starts.data[m + 1]; ++o) {
            %(seen)s
            const bool before = z > nearest;
            errors_out.data[2 * o] = before ? D[0] * off_x + D[1] * off_y : __builtin_inf();
            errors_out.data[2 * o + 1] = before ? D[2] * off_x + D[3] * off_y : __builtin_inf();
        }
    }
#endif
"""
_EQUATIONS = """
#if !defined(__CUDA_ARCH__)
    constexpr int lanes = %(lanes)d;
    typedef double Lanes __attribute__((ext_vector_type(lanes), aligned(8)));
    %(numbers)s
    const int width = screws.shape[3], chunks = width / lanes;
    const int shared = columns - 3;  // rows of the equations that all points share, the error's last
    double *of_shared = shared_out.data + (size_t)part * shared * width;
    double *rows[2] = {rows_out.data + (size_t)part * 2 * width, rows_out.data + ((size_t)part * 2 + 1) * width};
    const auto add = [&](double *to, double a, double b) {
        Lanes *sum = reinterpret_cast<Lanes*>(to);
        const Lanes *x = reinterpret_cast<const Lanes*>(rows[0]), *y = reinterpret_cast<const Lanes*>(rows[1]);
        for (int c = 0; c < chunks; ++c) sum[c] += a * x[c] + b * y[c];
    };
    for (int m = first; m < last; ++m) {
        const double *X = position + 3 * m;
        const int link = seen.link_of.data[m];
        double *own = own_out.data + (size_t)m * 3 * width;
        for (int o = seen.starts.data[m]; o < seen.starts.data[m + 1]; ++o) {
            %(seen)s
            const double weight = root.data[o], scale = weight * focal / z;
            // Slopes of the place by the position, by the lens, in the directions in which the place counts.
            const double along = squares < %(border)r ? 2.0 * bend / (corner * corner) : 0.0;
            const double sxx = grown + along * ax * ax, sxy = along * ax * ay, syy = grown + along * ay * ay;
            const double lens[2][2] = {{sxx, sxy}, {sxy, syy}};
            const double *screw = screws.data + ((size_t)link * screws.shape[1] + image) * 6 * width;
            for (int i = 0; i < 2; ++i) {
                const double u = D[2 * i] * lens[0][0] + D[2 * i + 1] * lens[1][0];
                const double v = D[2 * i] * lens[0][1] + D[2 * i + 1] * lens[1][1];
                const double b0 = scale * u, b1 = scale * v, b2 = -(b0 * nx + b1 * ny);
                const double six[6] = {b0, b1, b2, py * b2 - z * b1, z * b0 - px * b2, px * b1 - py * b0};
                Lanes *row = reinterpret_cast<Lanes*>(rows[i]);
                for (int c = 0; c < chunks; ++c) {
                    Lanes sum = 0.0;
                    for (int k = 0; k < 6; ++k) sum += six[k] * reinterpret_cast<const Lanes*>(screw + k * width)[c];
                    row[c] = sum;
                }
                rows[i][focal_column] = weight * (u * ax + v * ay);
                if (bends) rows[i][focal_column + 1] = weight * limited * (D[2 * i] * ax + D[2 * i + 1] * ay);
                rows[i][columns - 1] = weight * (D[2 * i] * off_x + D[2 * i + 1] * off_y);
            }
            for (int k = 0; k < 3; ++k) add(own + k * width, rows[0][k], rows[1][k]);
            for (int k = 0; k < shared; ++k) add(of_shared + k * width, rows[0][3 + k], rows[1][3 + k]);
        }
    }
#endif
"""
_SETTINGS = {"border": BORDER, "lanes": LANES, "numbers": _NUMBERS}
_SETTINGS["seen"] = _SEEN % _SETTINGS


@wp.func_native(_ERRORS % _SETTINGS)
def errors_of_points(
    seen: ObservedPoints,
    points: wp.array(dtype=wp.vec3d),
    camera: wp.array(dtype=wp.float64),
    nearest: wp.float64,
    first: int,
    last: int,
    errors_out: wp.array2d(dtype=wp.float64),
):
    """Errors of the points ``first`` to ``last``."""
    ...


@wp.func_native(_EQUATIONS % _SETTINGS)
def equations_of_points(
    seen: ObservedPoints,
    points: wp.array(dtype=wp.vec3d),
    camera: wp.array(dtype=wp.float64),
    root: wp.array(dtype=wp.float64),
    screws: wp.array4d(dtype=wp.float64),
    columns: int,
    focal_column: int,
    bends: bool,
    part: int,
    first: int,
    last: int,
    rows_out: wp.array3d(dtype=wp.float64),
    own_out: wp.array3d(dtype=wp.float64),
    shared_out: wp.array3d(dtype=wp.float64),
):
    """Equations of the points ``first`` to ``last``."""
    ...


@wp.kernel
def track_errors(
    # In:
    first: int,
    edges: wp.array(dtype=int),
    seen: ObservedPoints,
    points: wp.array(dtype=wp.vec3d),
    camera: wp.array(dtype=wp.float64),
    nearest: wp.float64,
    # Out:
    errors_out: wp.array2d(dtype=wp.float64),
):
    """Errors [px] of the points of a part, in the directions in which they count; infinite behind the camera.

    ``camera`` holds focal length, principal point, the lens's bend and its corner's distance.
    """
    part = first + wp.tid()
    errors_of_points(seen, points, camera, nearest, edges[part], edges[part + 1], errors_out)


@wp.kernel
def track_equations(
    # In:
    first: int,
    edges: wp.array(dtype=int),
    seen: ObservedPoints,
    points: wp.array(dtype=wp.vec3d),
    camera: wp.array(dtype=wp.float64),
    root: wp.array(dtype=wp.float64),
    screws: wp.array4d(dtype=wp.float64),
    columns: int,
    focal_column: int,
    bends: bool,
    # Out:
    rows_out: wp.array3d(dtype=wp.float64),
    own_out: wp.array3d(dtype=wp.float64),
    shared_out: wp.array3d(dtype=wp.float64),
):
    """Sums of the products of a part's rows: of each point's own three columns, and of those that all points share.

    ``screws`` ``(links, images, 6, width)`` gives the columns by the six numbers (b, p x b) of a row; ``own_out``
    ``(points, 3, width)`` and ``shared_out`` ``(parts, columns - 3, width)`` are 0 before, as are ``rows_out``
    ``(parts, 2, width)``, in which a place's two rows are worked out. The error's column is last.
    """
    part = first + wp.tid()
    equations_of_points(
        seen, points, camera, root, screws, columns, focal_column, bends,
        part, edges[part], edges[part + 1], rows_out, own_out, shared_out,
    )  # fmt: skip
