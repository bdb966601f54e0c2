"""The sums over a patch's pixels that an iteration of its alignment needs, and that take nearly all of its time.

With the image's gradient as seen in the patch, g = A' grad i(p + A x), and G = g (x, 1) as in
``patch_alignment.py``, these are weighted sums of 1, i, t, i^2, t^2, i t, G, G i, G t and G G'. Gray values i and t
count from that of the patch's middle: the squares of a bright surface's are so large that rounding their sums is more
than all that a plain one varies by. On a CPU a patch that lies well inside the image is summed up 8 pixels at a time,
in C++: Warp's loop over its pixels takes them one by one, which takes seven times as long.
"""

import warp as wp

from dense_vs.kernels.image.cubic_spline import sample_spline

wp.set_module_options({"enable_backward": False})

_LANES = 8  # pixels at once
_LINEAR, _PRODUCTS = 24, 21  # sums, and entries of G G' on and above its diagonal
_REACH = 3.0  # px about a patch in which the spline's taps lie

vec6 = wp.types.vector(6, wp.float32)
vec24 = wp.types.vector(_LINEAR, wp.float32)
mat66 = wp.types.matrix((6, 6), wp.float32)
vec_all = wp.types.vector(_LINEAR + _PRODUCTS, wp.float32)


@wp.func
def patch_sums(
    image: wp.array3d(dtype=wp.uint8),
    pixels: wp.array3d(dtype=wp.vec2),
    world: int,
    point: int,
    lane: int,
    stride: int,
    window: int,
    base_x: int,
    base_y: int,
    p: wp.vec2,
    affine: wp.mat22,
):
    """Weighted sums over every ``stride``-th pixel of a patch seen at base + p through ``affine``.

    Of 1, i, t, i^2, t^2, i t, G, G i and G t; of G G'; and of the weight of what is outside of the image.
    """
    sums = vec24()
    products = mat66()
    hidden = float(0.0)
    last_x = float(image.shape[2] - 1 - base_x)
    last_y = float(image.shape[1] - 1 - base_y)
    half = window // 2
    unit = 1.0 / float(half)  # D is sought in px at the patch's edge, as d is in px
    middle = pixels[world, point, window * window // 2][0]
    for k in range(lane, window * window, stride):
        pixel = pixels[world, point, k]
        w = pixel[1]
        if w > 0.0:
            t = pixel[0] - middle
            x = float(k % window - half)
            y = float(k // window - half)
            at = p + affine * wp.vec2(x, y)
            if at[0] >= float(-base_x) and at[1] >= float(-base_y) and at[0] <= last_x and at[1] <= last_y:
                floor_x = wp.floor(at[0])
                floor_y = wp.floor(at[1])
                left = base_x + int(floor_x)
                top = base_y + int(floor_y)
                seen = sample_spline(image, world, left, top, at[0] - floor_x, at[1] - floor_y)
                i = seen[0] - middle
                gx = affine[0, 0] * seen[1] + affine[1, 0] * seen[2]
                gy = affine[0, 1] * seen[1] + affine[1, 1] * seen[2]
                x *= unit
                y *= unit
                g = vec6(gx * x, gy * x, gx * y, gy * y, gx, gy)
                gw = g * w
                sums[0] = sums[0] + w
                sums[1] = sums[1] + w * i
                sums[2] = sums[2] + w * t
                sums[3] = sums[3] + w * i * i
                sums[4] = sums[4] + w * t * t
                sums[5] = sums[5] + w * i * t
                for j in range(6):
                    sums[6 + j] = sums[6 + j] + gw[j]
                    sums[12 + j] = sums[12 + j] + gw[j] * i
                    sums[18 + j] = sums[18 + j] + gw[j] * t
                products += wp.outer(gw, g)
            else:
                hidden += w
    return sums, products, hidden


@wp.func
def is_well_inside(
    image: wp.array3d(dtype=wp.uint8), window: int, base_x: int, base_y: int, p: wp.vec2, affine: wp.mat22
) -> bool:
    """Whether all that a patch draws on is inside the image."""
    half = float(window // 2)
    reach_x = half * (wp.abs(affine[0, 0]) + wp.abs(affine[0, 1])) + wp.static(_REACH)
    reach_y = half * (wp.abs(affine[1, 0]) + wp.abs(affine[1, 1])) + wp.static(_REACH)
    x = float(base_x) + p[0]
    y = float(base_y) + p[1]
    last_x = float(image.shape[2] - 1)
    last_y = float(image.shape[1] - 1)
    return x >= reach_x and y >= reach_y and x + reach_x <= last_x and y + reach_y <= last_y


_SUM_INSIDE = f"""
    wp::vec_t<{_LINEAR + _PRODUCTS}, wp::float32> out;
#if !defined(__CUDA_ARCH__)
    constexpr int lanes = {_LANES}, linear = {_LINEAR}, all = {_LINEAR + _PRODUCTS};
    typedef float Lanes __attribute__((ext_vector_type(lanes)));
    typedef float Pairs __attribute__((ext_vector_type(2 * lanes)));
    typedef int Whole __attribute__((ext_vector_type(lanes)));
    const int row = (int)image.strides[1], half = window / 2, count = window * window;
    const wp::uint8 *origin = image.data + world * image.strides[0] + base_y * row + base_x;
    const size_t first_pixel = (size_t)(world * pixels.shape[1] + point) * count;
    const float *patch = reinterpret_cast<const float*>(pixels.data + first_pixel);
    const float middle = patch[2 * (count / 2)];
    const float unit = 1.0f / half, side = (float)window, last = (float)half;
    const float xx = affine.data[0][0], xy = affine.data[0][1], yx = affine.data[1][0], yy = affine.data[1][1];
    // As spline_weights, spline_slopes and sample_spline of cubic_spline.py.
    const auto weights = [](Lanes a, Lanes *of) {{
        const Lanes b = 1.0f - a, aa = a * a, bb = b * b;
        of[0] = b * bb * (1.0f / 6.0f);
        of[1] = (aa * (3.0f * a - 6.0f) + 4.0f) * (1.0f / 6.0f);
        of[2] = (bb * (3.0f * b - 6.0f) + 4.0f) * (1.0f / 6.0f);
        of[3] = a * aa * (1.0f / 6.0f);
    }};
    const auto slopes = [](Lanes a, Lanes *of) {{
        const Lanes b = 1.0f - a;
        of[0] = -b * b * 0.5f;
        of[1] = a * (3.0f * a - 4.0f) * 0.5f;
        of[2] = b * (4.0f - 3.0f * b) * 0.5f;
        of[3] = a * a * 0.5f;
    }};
    Lanes sum[all];
    for (int s = 0; s < all; ++s) sum[s] = 0.0f;
    Lanes x, y;  // of the pixels, from the patch's center
    for (int lane = 0; lane < lanes; ++lane) {{
        x[lane] = (float)(lane % window - half);
        y[lane] = (float)(lane / window - half);
    }}
    for (int k = 0; k < count; k += lanes) {{
        Pairs pairs = 0.0f;
        if (count - k >= lanes) {{
            __builtin_memcpy(&pairs, patch + 2 * k, sizeof(pairs));
        }} else {{  // what is beyond the patch's end has no weight and is drawn from its center
            float rest[2 * lanes] = {{}};
            __builtin_memcpy(rest, patch + 2 * k, (count - k) * 2 * sizeof(float));
            __builtin_memcpy(&pairs, rest, sizeof(pairs));
            for (int lane = count - k; lane < lanes; ++lane) x[lane] = y[lane] = 0.0f;
        }}
        const Lanes t = __builtin_shufflevector(pairs, pairs, 0, 2, 4, 6, 8, 10, 12, 14) - middle;
        const Lanes w = __builtin_shufflevector(pairs, pairs, 1, 3, 5, 7, 9, 11, 13, 15);
        const Lanes at_x = p.c[0] + xx * x + xy * y, at_y = p.c[1] + yx * x + yy * y;
        const Lanes left = __builtin_elementwise_floor(at_x), top = __builtin_elementwise_floor(at_y);
        const Whole first = (__builtin_convertvector(top, Whole) - 1) * row + __builtin_convertvector(left, Whole) - 1;
        Lanes across_weights[4], across_slopes[4], down_weights[4], down_slopes[4];
        weights(at_x - left, across_weights), slopes(at_x - left, across_slopes);
        weights(at_y - top, down_weights), slopes(at_y - top, down_slopes);
        Lanes i = -128.0f - middle, slope_x = 0.0f, slope_y = 0.0f;
        for (int tap = 0; tap < 4; ++tap) {{
            int four[lanes];  // neighboring pixels, a byte each
            for (int lane = 0; lane < lanes; ++lane) __builtin_memcpy(&four[lane], origin + first[lane] + tap * row, 4);
            Whole bytes;
            __builtin_memcpy(&bytes, four, sizeof(bytes));
            Lanes across = 0.0f, along = 0.0f;
            for (int c = 0; c < 4; ++c) {{
                const Lanes gray = __builtin_convertvector((bytes >> (8 * c)) & 255, Lanes);
                across += across_weights[c] * gray;
                along += across_slopes[c] * gray;
            }}
            i += down_weights[tap] * across;
            slope_x += down_weights[tap] * along;
            slope_y += down_slopes[tap] * across;
        }}
        const Lanes gx = xx * slope_x + yx * slope_y, gy = xy * slope_x + yy * slope_y;
        const Lanes at_edge_x = x * unit, at_edge_y = y * unit;
        const Lanes g[6] = {{gx * at_edge_x, gy * at_edge_x, gx * at_edge_y, gy * at_edge_y, gx, gy}};
        const Lanes wi = w * i, wt = w * t;
        sum[0] += w, sum[1] += wi, sum[2] += wt, sum[3] += wi * i, sum[4] += wt * t, sum[5] += wi * t;
        int product = linear;
        for (int j = 0; j < 6; ++j) {{
            const Lanes gw = g[j] * w;
            sum[6 + j] += gw, sum[12 + j] += gw * i, sum[18 + j] += gw * t;
            for (int l = j; l < 6; ++l) sum[product++] += gw * g[l];
        }}
        x += (float)lanes;
        for (int wrap = 0; wrap * window < lanes; ++wrap) {{
            const Whole beyond = x > last;
            x = beyond ? x - side : x;
            y = beyond ? y + 1.0f : y;
        }}
    }}
    for (int s = 0; s < all; ++s) {{
        const auto four = sum[s].lo + sum[s].hi;
        const auto two = four.lo + four.hi;
        out[s] = two.x + two.y;
    }}
#endif
    return out;
"""


@wp.func_native(_SUM_INSIDE)
def sum_inside(
    image: wp.array3d(dtype=wp.uint8),
    pixels: wp.array3d(dtype=wp.vec2),
    world: int,
    point: int,
    window: int,
    base_x: int,
    base_y: int,
    p: wp.vec2,
    affine: wp.mat22,
) -> vec_all:
    """The same of a patch well inside the image: first the sums, then G G' on and above its diagonal."""
    ...


@wp.func
def patch_sums_on_cpu(
    image: wp.array3d(dtype=wp.uint8),
    pixels: wp.array3d(dtype=wp.vec2),
    world: int,
    point: int,
    window: int,
    base_x: int,
    base_y: int,
    p: wp.vec2,
    affine: wp.mat22,
):
    """As :func:`patch_sums` of all pixels, for one thread a patch; the sums differ in rounding only."""
    sums = vec24()
    products = mat66()
    hidden = float(0.0)
    if is_well_inside(image, window, base_x, base_y, p, affine):
        found = sum_inside(image, pixels, world, point, window, base_x, base_y, p, affine)
        for k in range(wp.static(_LINEAR)):
            sums[k] = found[k]
        entry = int(wp.static(_LINEAR))
        for i in range(6):
            for j in range(i, 6):
                products[i, j] = found[entry]
                products[j, i] = found[entry]
                entry += 1
    else:
        sums, products, hidden = patch_sums(image, pixels, world, point, 0, 1, window, base_x, base_y, p, affine)
    return sums, products, hidden
