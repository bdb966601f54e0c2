"""Taps of a row's pixels, a block of them at once, in C++ for a CPU.

Finding where a pixel's four taps lie takes longer than reading them, unless the compiler sees one plain loop over
pixels, which it then does 16 pixels at a time. Warp's loops over its arrays are none, so these are written in C++ and
put before the loops of a row that use them. Arithmetic and order are those of ``pixel_shift`` in ``moved_pixels.py``
and :func:`dense_vs.kernels.image.bilinear.bilinear_taps`; a test holds them to the same bits.
"""

# Of at most ``block`` pixels from ``first`` in row ``y``, in an image of ``width`` x ``height``: ``moved_taps`` finds
# the taps of where the pixels were by an image of shifts, ``taps_at`` those of the shifts that they hold, ``sampled``
# reads an image of pairs by them. In this order: upper left, upper right, lower left, lower right.
BLOCK_TAPS = """
    typedef float Pair __attribute__((ext_vector_type(2), aligned(4)));
    constexpr int block = 64;
    struct Taps { float shift_x[block], shift_y[block]; int place[4][block]; float weight[4][block]; };
    const auto is_finite = [](Pair u) { return u.x - u.x == 0.0f && u.y - u.y == 0.0f; };
    const auto within = [](int place, int size) { return place < 0 ? 0 : (place > size - 1 ? size - 1 : place); };
    const auto taps_at = [&](Taps &taps, int first, int count) {
        const float across = (float)width, down = (float)height;
        for (int k = 0; k < count; ++k) {
            const float dx = __builtin_elementwise_min(__builtin_elementwise_max(-taps.shift_x[k], -across), across);
            const float dy = __builtin_elementwise_min(__builtin_elementwise_max(-taps.shift_y[k], -down), down);
            const float floor_x = __builtin_elementwise_floor(dx), floor_y = __builtin_elementwise_floor(dy);
            const float ax = dx - floor_x, ay = dy - floor_y;
            const int begin_x = first + k + (int)floor_x, begin_y = y + (int)floor_y;
            const int left = within(begin_x, width), right = within(begin_x + 1, width);
            const int upper = within(begin_y, height) * width, lower = within(begin_y + 1, height) * width;
            taps.place[0][k] = upper + left;
            taps.place[1][k] = upper + right;
            taps.place[2][k] = lower + left;
            taps.place[3][k] = lower + right;
            taps.weight[0][k] = (1.0f - ax) * (1.0f - ay);
            taps.weight[1][k] = ax * (1.0f - ay);
            taps.weight[2][k] = (1.0f - ax) * ay;
            taps.weight[3][k] = ax * ay;
        }
    };
    const auto sampled = [](const Pair *image, const Taps &taps, int k) {
        const auto tap = [&](int corner) { return image[taps.place[corner][k]] * taps.weight[corner][k]; };
        return (tap(0) + tap(1)) + (tap(2) + tap(3));
    };
    // x - v(x), x - v(x - v(x)), ...; DIJE (13), (14)
    const auto moved_taps = [&](Taps &taps, const Pair *image, int iterations, int first, int count) {
        const Pair *shifts = image + (size_t)y * width + first;
        for (int k = 0; k < count; ++k) {
            const bool moves = iterations > 0 && is_finite(shifts[k]);
            taps.shift_x[k] = moves ? shifts[k].x : 0.0f;
            taps.shift_y[k] = moves ? shifts[k].y : 0.0f;
        }
        for (int done = 1;; ++done) {
            taps_at(taps, first, count);
            if (done >= iterations) break;
            for (int k = 0; k < count; ++k) {
                const Pair shift = sampled(image, taps, k);
                taps.shift_x[k] = is_finite(shifts[k]) ? shift.x : 0.0f;
                taps.shift_y[k] = is_finite(shifts[k]) ? shift.y : 0.0f;
            }
        }
    };
"""
