"""One step of Lucas and Kanade's flow in Gaussian windows, in a single pass over the image, for a CPU.

The previous image is brought to where the flow so far says it is; gradients and change give five products a pixel;
their sums in the window are the equations. A thread walks down a band of rows and keeps of each of these only the rows
that the window reaches, so that all of it stays in its core's cache: written to images of their own, the products take
three times as long to move as to compute. Sums along a row are made for 64 pixels at once and sums along columns
for 4 rows, so that every number read is used by several of them. Beyond the border an image is its own mirror
image, the border pixels themselves not repeated. No pixel depends on how the bands are cut.
"""

from functools import cache
from itertools import pairwise

import warp as wp

from dense_vs.kernels.image.pixel_runs import run_module
from dense_vs.kernels.image.row_taps import BLOCK_TAPS

_PRODUCTS = 5  # gx gx, gx gy, gy gy, gx change, gy change
_LANES, _GROUP, _BATCH = 16, 4, 4  # numbers in a vector, vectors summed along a row at once, rows along columns
_TILE = 128  # columns that a thread goes down at a time
_KEPT = 8  # rows of warped image, of which gradients need 5


def scratch_floats(radius: int) -> int:
    """Floats that a band works in: rows of summed products and of warped images, and one row of products."""
    reached = _TILE + 2 * radius + 4
    return _PRODUCTS * (2 * radius + _BATCH) * _TILE + (2 * _KEPT + _PRODUCTS) * reached


_STEP = f"""
#if !defined(__CUDA_ARCH__)
    constexpr int radius = %(radius)d, lanes = {_LANES}, group = {_GROUP}, batch = {_BATCH}, products = {_PRODUCTS};
    constexpr int reach = 2 * radius, slots = reach + batch, kept = {_KEPT};
    constexpr int tile = {_TILE}, reached = tile + reach + 4;
    typedef float Lanes __attribute__((ext_vector_type(lanes), aligned(4)));
    const int width = before.shape[1], height = before.shape[0];
    const int band_begin = height * number / bands, band_end = height * (number + 1) / bands;
    // Of a row that the tile's windows reach, x from ``left`` on; sums of products of the tile alone, vector by vector.
    float *summed = scratch.data + (size_t)number * scratch.shape[1];
    float *means = summed + products * slots * tile, *changes = means + kept * reached;
    float *product = changes + kept * reached;
    int tile_begin = 0, tile_end = 0, left = 0, from = 0, to = 0;  // products are of x from ``from`` to ``to``
    const auto mirrored = [](int place, int size) {{
        while (place < 0 || place > size - 1) place = place < 0 ? -place : 2 * (size - 1) - place;
        return place;
    }};
    int y = 0;
    float shares[reach + 2 * batch] = {{}};  // zeros around those of the window
    for (int k = 0; k <= reach; ++k) shares[batch + k] = window.data[k];
    {BLOCK_TAPS}
    const Pair *shifts = reinterpret_cast<const Pair*>(flow_in.data);
    Pair *out = reinterpret_cast<Pair*>(flow_out.data);

    // Mean of the present row and the previous image's at the same surface points, and the second less the first.
    const auto warp_row = [&]() {{
        Taps taps;
        const int begin = from - 2 < 0 ? 0 : from - 2, end = to + 2 > width ? width : to + 2;
        for (int first = begin; first < end; first += block) {{
            const int count = end - first < block ? end - first : block;
            const float *of_now = now.data + (size_t)y * width + first;
            float *mean = means + (y & (kept - 1)) * reached + first - left;
            float *change = changes + (y & (kept - 1)) * reached + first - left;
            float warped[block];
            moved_taps(taps, shifts, 1, first, count);
            for (int k = 0; k < count; ++k) {{
                const auto tap = [&](int c) {{ return before.data[taps.place[c][k]] * taps.weight[c][k]; }};
                warped[k] = (tap(0) + tap(1)) + (tap(2) + tap(3));
            }}
            for (int k = 0; k < count; ++k) {{
                mean[k] = 0.5f * (warped[k] + of_now[k]);
                change[k] = warped[k] - of_now[k];
            }}
        }}
    }};
    const auto slope = [](float before_2, float before, float after, float after_2) {{
        return (before_2 - after_2) * (1.0f / 12.0f) + (after - before) * (8.0f / 12.0f);
    }};
    const auto sum_row = [&](int row) {{
        const auto mean_of = [&](int away) {{
            return means + (mirrored(row + away, height) & (kept - 1)) * reached - left;
        }};
        const float *above_2 = mean_of(-2), *above = mean_of(-1), *own = mean_of(0);
        const float *below = mean_of(1), *below_2 = mean_of(2);
        const float *change = changes + (row & (kept - 1)) * reached - left;
        float *xx = product - left, *xy = xx + reached, *yy = xy + reached, *xc = yy + reached, *yc = xc + reached;
        const int inner_from = from < 2 ? 2 : from, inner_to = to > width - 2 ? width - 2 : to;
        for (int x = inner_from; x < inner_to; ++x) xx[x] = slope(own[x - 2], own[x - 1], own[x + 1], own[x + 2]);
        const auto at = [&](int x) {{ return own[mirrored(x, width)]; }};
        for (int edge = 0; edge < 4; ++edge) {{
            const int x = edge < 2 ? edge : width - 4 + edge;
            if (x >= from && x < to) xx[x] = slope(at(x - 2), at(x - 1), at(x + 1), at(x + 2));
        }}
        for (int x = from; x < to; ++x) {{
            const float gx = xx[x], gy = slope(above_2[x], above[x], below[x], below_2[x]), c = change[x];
            xx[x] = gx * gx, xy[x] = gx * gy, yy[x] = gy * gy, xc[x] = gx * c, yc[x] = gy * c;
        }}
        float *slot = summed + (row %% slots) * products * tile;
        for (int p = 0; p < products; ++p) {{
            float *values = product + p * reached - left;
            for (int x = tile_begin - radius; x < from; ++x) values[x] = values[mirrored(x, width)];
            for (int x = to; x < tile_end + radius; ++x) values[x] = values[mirrored(x, width)];
        }}
        for (int first = 0; first < tile; first += group * lanes) {{
            const float *begin = product + 2 + first;  // of the first window
            Lanes sum[group][products];
            for (int v = 0; v < group; ++v)
                for (int p = 0; p < products; ++p) sum[v][p] = 0.0f;
            const auto add = [&](int v, int k) {{
                const float share = shares[batch + k - v * lanes];
                for (int p = 0; p < products; ++p)
                    sum[v][p] += share * *reinterpret_cast<const Lanes*>(begin + p * reached + k);
            }};
            %(along_row)s
            for (int v = 0; v < group; ++v)
                for (int p = 0; p < products; ++p)
                    *reinterpret_cast<Lanes*>(slot + ((first / lanes + v) * products + p) * lanes) = sum[v][p];
        }}
    }};
    const auto solve_rows = [&](int top) {{
        const float *rows[slots];
        for (int k = 0; k < slots; ++k)
            rows[k] = summed + (mirrored(top - radius + k, height) %% slots) * products * tile;
        const int count = band_end - top < batch ? band_end - top : batch;
        for (int v = 0; tile_begin + v * lanes < tile_end; ++v) {{
            Lanes sum[batch][products];
            for (int j = 0; j < batch; ++j)
                for (int p = 0; p < products; ++p) sum[j][p] = 0.0f;
            for (int k = 0; k < slots; ++k) {{
                const Lanes *numbers = reinterpret_cast<const Lanes*>(rows[k] + v * products * lanes);
                for (int j = 0; j < batch; ++j)
                    for (int p = 0; p < products; ++p) sum[j][p] += shares[batch + k - j] * numbers[p];
            }}
            for (int j = 0; j < count; ++j) {{
                const Lanes xx = sum[j][0] + weight, xy = sum[j][1], yy = sum[j][2] + weight;
                const Lanes bx = sum[j][3], by = sum[j][4], most = max_step;
                const Lanes least = 0.5f * weight * weight;
                const Lanes per = 1.0f / __builtin_elementwise_max(xx * yy - xy * xy, least);
                const Lanes dx = __builtin_elementwise_max((yy * bx - xy * by) * per, -most);
                const Lanes dy = __builtin_elementwise_max((xx * by - xy * bx) * per, -most);
                const Lanes step_x = __builtin_elementwise_min(dx, most), step_y = __builtin_elementwise_min(dy, most);
                const int x = tile_begin + v * lanes, wide = tile_end - x < lanes ? tile_end - x : lanes;
                const size_t place = (size_t)(top + j) * width + x;
                for (int lane = 0; lane < wide; ++lane)
                    out[place + lane] = shifts[place + lane] + Pair{{step_x[lane], step_y[lane]}};
            }}
        }}
    }};

    for (tile_begin = 0; tile_begin < width; tile_begin += tile) {{
        tile_end = tile_begin + tile < width ? tile_begin + tile : width;
        left = tile_begin - radius - 2;
        from = tile_begin - radius < 0 ? 0 : tile_begin - radius;
        to = tile_end + radius > width ? width : tile_end + radius;
        int row = band_begin - radius < 0 ? 0 : band_begin - radius;
        y = row - 2 < 0 ? 0 : row - 2;
        for (int top = band_begin; top < band_end; top += batch) {{
            const int last = top + batch - 1 + radius < height - 1 ? top + batch - 1 + radius : height - 1;
            for (; row <= last; ++row) {{
                for (; y <= row + 2 && y < height; ++y) warp_row();
                sum_row(row);
            }}
            solve_rows(top);
        }}
    }}
#endif
"""


def _along_row(radius: int) -> str:
    """Loops that add every vector of numbers to the sums of all those vectors whose windows it is in."""
    windows = [(v * _LANES, v * _LANES + 2 * radius + 1) for v in range(_GROUP)]
    edges = sorted({edge for window in windows for edge in window})
    loops = ""
    for begin, end in pairwise(edges):
        sums = " ".join(f"add({v}, k);" for v, (first, last) in enumerate(windows) if first <= begin and end <= last)
        loops += f"for (int k = {begin}; k < {end}; ++k) {{ {sums} }}\n"
    return loops


@cache
def lucas_kanade_kernel(radius: int) -> wp.Kernel:
    """The kernel for a window of 2 ``radius`` + 1 pixels; launched with a row a band."""

    @wp.func_native(_STEP % {"radius": radius, "along_row": _along_row(radius)})
    def step_band(
        before: wp.array2d(dtype=float),
        now: wp.array2d(dtype=float),
        flow_in: wp.array2d(dtype=wp.vec2),
        window: wp.array(dtype=float),
        weight: float,
        max_step: float,
        scratch: wp.array2d(dtype=float),
        flow_out: wp.array2d(dtype=wp.vec2),
        number: int,
        bands: int,
    ): ...

    @wp.kernel(module=run_module(f"{__name__}_{radius}"), enable_backward=False)
    def lucas_kanade_step(
        row_begin: int,
        column_step: int,
        # In:
        before_in: wp.array2d(dtype=float),  # (H, W)
        now_in: wp.array2d(dtype=float),
        flow_in: wp.array2d(dtype=wp.vec2),
        window_in: wp.array(dtype=float),  # (2 radius + 1), symmetric
        weight: float,  # lambda [gray levels^2 / px^2]
        max_step: float,  # [px]
        # Out:
        scratch_out: wp.array2d(dtype=float),  # (bands, scratch_floats)
        flow_out: wp.array2d(dtype=wp.vec2),
    ):
        """The flow after one more step; a row of the launch is a band of the image."""
        _, row, _ = wp.tid()
        step_band(
            before_in,
            now_in,
            flow_in,
            window_in,
            weight,
            max_step,
            scratch_out,
            flow_out,
            row_begin + row,
            scratch_out.shape[0],
        )

    return lucas_kanade_step
